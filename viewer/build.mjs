// Bundles the viewer into the Python package: `npm ci --ignore-scripts && npm run build` in this folder.
import { createHash } from "node:crypto";
import { copyFileSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const target = join(here, "..", "taichi_membrane", "page");
const sha256 = (...parts) => parts.reduce((hash, part) => hash.update(part), createHash("sha256")).digest("hex");

// What the bundle is made of, in the order of names; package-lock.json fixes three and esbuild.
const sources = [...readdirSync(join(here, "src")).sort().map((name) => join("src", name)), "build.mjs", "package.json", "package-lock.json"];
const made = await build({
  entryPoints: [join(here, "src", "main.js")], bundle: true, minify: true, write: false, format: "iife", target: "es2022", legalComments: "none",
});
const code = made.outputFiles[0].text.replaceAll("</script", "<\\/script");
const seal = `/* sources ${sha256(...sources.map((name) => readFileSync(join(here, name))))} code ${sha256(code)} */\n`;
writeFileSync(join(target, "viewer.js"), seal + code);
copyFileSync(join(here, "node_modules", "three", "LICENSE"), join(target, "THREE-LICENSE"));
