// What lies over the view: axes, scale bar, labels of loads; and the colour bar or legend beside it.
import { Vector3 } from "three";
import { byId, html, svg } from "./svg.js";
import { show } from "./quantity.js";
import { cableLegend } from "./cables.js";

const AXES = [["x", "#b3261e"], ["y", "#1e7a34"], ["z", "#1f4fb0"]];

export function drawOver(stage, marks, head, step) {
  const over = byId("over");
  const { clientWidth: width, clientHeight: height } = over;
  over.replaceChildren();
  over.setAttribute("viewBox", `0 0 ${width} ${height}`); // printed on another size it stays with the picture
  const [ox, oy] = [46, height - 46];
  const inverse = stage.camera.quaternion.clone().invert();
  AXES.forEach(([name, colour], c) => {
    const seen = new Vector3().setComponent(c, 1).applyQuaternion(inverse);
    const [x, y] = [ox + 30 * seen.x, oy - 30 * seen.y];
    over.append(svg("line", { x1: ox, y1: oy, x2: x, y2: y, stroke: colour, "stroke-width": 2 }));
    over.append(svg("text", { x: ox + 40 * seen.x, y: oy - 40 * seen.y + 4, fill: colour, "text-anchor": "middle" }, name));
  });
  scaleBar(over, stage, head, width, height);
  marks.labels(step).filter(({ shown }) => shown).forEach(({ text, at }) => {
    const [x, y] = stage.project(at);
    over.append(svg("text", { x, y: y - 6, class: "load", "text-anchor": "middle" }, text));
  });
}

// A round length at the depth of the middle of the view.
function scaleBar(over, stage, head, width, height) {
  const distance = stage.camera.position.distanceTo(stage.controls.target);
  const perLength = height / (2 * distance * Math.tan((stage.camera.fov * Math.PI) / 360));
  const most = 0.2 * width / perLength;
  const power = 10 ** Math.floor(Math.log10(most));
  const length = power * [5, 2, 1].find((step) => step * power <= most);
  const [right, y] = [width - 24, height - 24];
  over.append(svg("line", { x1: right - length * perLength, y1: y, x2: right, y2: y, stroke: "#20242c", "stroke-width": 3 }));
  over.append(svg("text", { x: right, y: y - 8, "text-anchor": "end" }, `${show(length)} ${head.units.length}`));
}

// Round-off beside the large values of a range is zero, as in the tables.
const clean = (value, range) => (Math.abs(value) < 1e-12 * Math.max(...range.map(Math.abs)) ? 0 : value);

export function drawLegend(head, choice, range, step, found, pick) {
  const legend = byId("legend");
  legend.replaceChildren();
  if (choice.kind === "state") {
    head.states.forEach((name, state) => {
      const row = html("span", "", "entry");
      const swatch = html("i", "", "swatch");
      swatch.style.background = `rgb(${head.palette[state]})`;
      row.append(swatch, `${name} ${(100 * head.steps[step].shares[state]).toFixed(1)} %`);
      legend.append(row);
    });
    legend.append(html("span", "of the area; lines: along the wrinkles", "entry quiet"));
    cableLegend(legend, head);
    return;
  }
  const bar = html("span", "", "bar");
  const stops = [0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1].map((at) => head.ramp[Math.round(at * (head.ramp.length - 1))]);
  bar.style.background = `linear-gradient(90deg, ${stops.map((rgb) => `rgb(${rgb})`)})`;
  const ticks = html("span", "", "ticks");
  [0, 0.25, 0.5, 0.75, 1].forEach((at) => ticks.append(html("span", show(clean(range[0] + at * (range[1] - range[0]), range)))));
  const scale = html("span", "", "scale");
  scale.append(bar, ticks);
  legend.append(html("span", `${choice.title}${choice.unit ? ` [${choice.unit}]` : ""}`, "entry name"), scale);
  if (found) {
    for (const [word, place, value] of [["least", found.least, found.low], ["largest", found.most, found.high]]) {
      const button = html("button", `${word} ${show(clean(value, range), choice.unit)} at ${choice.kind} ${place}`, "entry");
      button.type = "button";
      button.onclick = () => pick(choice.kind, place);
      legend.append(button);
    }
  }
  if (choice.note) legend.append(html("span", choice.note, "entry quiet"));
  cableLegend(legend, head);
}
