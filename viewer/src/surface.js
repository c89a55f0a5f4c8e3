// The membrane: three vertices an element, moved and coloured on the graphics card between two steps.
import { BufferAttribute, BufferGeometry, DataTexture, DoubleSide, GLSL3, LinearFilter, Mesh, RGBAFormat, ShaderMaterial, Vector3 } from "three";
import { extremes, values } from "./quantity.js";

const NO_VALUE = -1000; // below any place on the colour bar, which is 0 to 1

const VERTEX = `
in vec3 startMove; in vec3 endMove; in vec3 startNormal; in vec3 endNormal; in vec4 margins; in vec2 level;
uniform float share; uniform float exaggeration;
out vec3 turned; out vec2 margin; out float value; out vec3 corner;
void main() {
  turned = normalMatrix * mix(startNormal, endNormal, share);
  margin = mix(margins.xy, margins.zw, share);
  value = mix(level.x, level.y, share);
  corner = vec3(gl_VertexID % 3 == 0, gl_VertexID % 3 == 1, gl_VertexID % 3 == 2);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position + exaggeration * mix(startMove, endMove, share), 1.0);
}`;

const FRAGMENT = `
in vec3 turned; in vec2 margin; in float value; in vec3 corner;
uniform bool byState; uniform bool meshLines; uniform vec3 palette[3]; uniform sampler2D ramp; uniform float darkest;
out vec4 colour;
float cover(float distance) { return 1.0 - smoothstep(0.3, 1.3, abs(distance) / max(fwidth(distance), 1e-20)); }
void main() {
  vec3 paint = vec3(0.62);
  if (byState) {
    paint = margin.y < 0.0 ? palette[2] : margin.x < 0.0 ? palette[1] : palette[0];
    paint = mix(paint, vec3(0.13, 0.15, 0.19), 0.7 * max(cover(margin.x) * step(0.0, margin.y), cover(margin.y)));
  } else if (value > -1.0) {
    paint = texture(ramp, vec2(clamp(value, 0.0, 1.0), 0.5)).rgb;
  }
  vec3 n = normalize(turned) * (gl_FrontFacing ? 1.0 : -1.0);
  float light = max(0.0, dot(n, normalize(vec3(-0.35, 0.55, 1.0))));
  paint *= darkest + (1.0 - darkest) * light;
  if (meshLines) {
    vec3 near = corner / max(fwidth(corner), vec3(1e-9));
    paint *= mix(0.55, 1.0, smoothstep(0.3, 1.3, min(near.x, min(near.y, near.z))));
  }
  colour = vec4(paint, 1.0);
}`;

export class Surface {
  constructor(run) {
    this.run = run;
    const count = run.triangles.length;
    this.geometry = new BufferGeometry();
    const sizes = { position: 3, startMove: 3, endMove: 3, startNormal: 3, endNormal: 3, margins: 4, level: 2 };
    for (const [name, size] of Object.entries(sizes)) this.geometry.setAttribute(name, new BufferAttribute(new Float32Array(size * count), size));
    this.#fill("position", run.rest, 0, 3);
    const colours = Uint8Array.from(run.head.ramp.flatMap((rgb) => [...rgb, 255]));
    const ramp = new DataTexture(colours, run.head.ramp.length, 1, RGBAFormat);
    ramp.minFilter = ramp.magFilter = LinearFilter;
    ramp.needsUpdate = true;
    const palette = run.head.palette.map((rgb) => new Vector3(...rgb).divideScalar(255));
    this.uniforms = Object.fromEntries(
      Object.entries({ share: 0, exaggeration: 1, byState: true, meshLines: false, palette, ramp, darkest: 0.55 }).map(([k, value]) => [k, { value }]),
    );
    const material = new ShaderMaterial({
      uniforms: this.uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, glslVersion: GLSL3, side: DoubleSide,
      polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2, // lines lie on it
    });
    this.mesh = new Mesh(this.geometry, material);
    this.mesh.frustumCulled = false;
    this.shown = "";
    this.painted = "";
  }

  // Values of nodes (3 rows an element) or of elements into some components of an attribute.
  #fill(name, list, first, width, perElement = false) {
    const { array, itemSize } = this.geometry.attributes[name];
    const { triangles } = this.run;
    for (let v = 0; v < triangles.length; v++) {
      const from = perElement ? Math.floor(v / 3) : triangles[v];
      for (let c = 0; c < width; c++) array[itemSize * v + first + c] = list[width * from + c];
    }
    this.geometry.attributes[name].needsUpdate = true;
  }

  // Show a time between two steps; what lies on the card is exchanged when the steps change.
  place(time, exaggeration) {
    const { start, end, share } = this.run.between(time);
    this.uniforms.share.value = share;
    this.uniforms.exaggeration.value = exaggeration;
    this.pair = [start, end];
    if (this.shown === `${start} ${exaggeration}`) return;
    this.shown = `${start} ${exaggeration}`;
    [["start", start, 0], ["end", end, 2]].forEach(([name, step, first]) => {
      this.#fill(`${name}Move`, this.run.move(step), 0, 3);
      this.#fill(`${name}Normal`, this.run.normals(step, exaggeration), 0, 3);
      this.#fill("margins", this.run.steps[step].tautMargin, first, 1);
      this.#fill("margins", this.run.steps[step].slackMargin, first + 1, 1);
    });
  }

  paint(choice, range) {
    const key = `${choice.key} ${this.pair} ${range}`;
    if (this.painted === key) return;
    this.painted = key;
    this.uniforms.byState.value = choice.kind === "state";
    this.uniforms.darkest.value = choice.kind === "state" ? 0.55 : 0.8;
    if (choice.kind === "state") return;
    const [low, high] = range;
    this.pair.forEach((step, place) => {
      const level = values(this.run, choice, step).map((v) => (v === null ? NO_VALUE : high > low ? (v - low) / (high - low) : 0.5));
      this.#fill("level", level, place, 1, choice.kind === "element");
    });
  }
}

// Range of a quantity over the whole run, worked out once.
const known = {};
export function runRange(run, choice) {
  if (choice.kind === "element") return [choice.low, choice.high];
  known[choice.key] ??= run.steps.reduce(
    ([low, high], _, step) => {
      const found = extremes(run, choice, step);
      return found ? [Math.min(low, found.low), Math.max(high, found.high)] : [low, high];
    },
    [Infinity, -Infinity],
  );
  return known[choice.key];
}
