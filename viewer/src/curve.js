// The curve of two quantities over the steps, with the present step on it.
import { byId, svg } from "./svg.js";
import { show } from "./quantity.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [460, 300, 70, 16, 14, 50];

export class Curve {
  constructor(head, go) {
    this.head = head;
    this.go = go;
    [this.across, this.up] = [byId("curve-x"), byId("curve-y")];
    for (const [select, chosen] of [[this.across, head.curve.x], [this.up, head.curve.y]]) {
      head.quantities.forEach(({ name, label }) => select.add(new Option(label, name, name === chosen, name === chosen)));
      select.onchange = () => this.draw(this.time);
    }
  }

  // The scene's own curve has scales, labels, references and a range of steps; any other choice is plain.
  #chosen() {
    const { curve, quantities } = this.head;
    const [x, y] = [this.across.value, this.up.value].map((name) => quantities.find((one) => one.name === name));
    const own = x.name === curve.x && y.name === curve.y;
    const steps = own ? curve.steps : this.head.steps.map((_, step) => step).filter((step) => this.head.steps[step].converged);
    return {
      steps,
      x: x.values.map((value) => (own ? curve.x_scale : 1) * value),
      y: y.values.map((value) => (own ? curve.y_scale : 1) * value),
      xLabel: own ? curve.x_label : x.label,
      yLabel: own ? curve.y_label : y.label,
      references: own ? curve.references : [],
      lines: own ? curve.lines : [],
    };
  }

  draw(time) {
    this.time = time;
    const chosen = this.#chosen();
    const { steps, x, y } = chosen;
    const all = (axis) => [...steps.map((step) => chosen[axis][step]), ...chosen.references.flatMap((one) => one[axis]), ...chosen.lines.filter((line) => line.axis === axis).map((line) => line.value)];
    const [px, py] = [scale(all("x"), LEFT, WIDTH - RIGHT), scale(all("y"), HEIGHT - BOTTOM, TOP)];
    const drawing = byId("curve");
    drawing.replaceChildren(...axes(px, py, chosen));
    chosen.lines.forEach(({ axis, value, label }) => {
      const [x1, x2] = axis === "x" ? [px(value), px(value)] : [LEFT, WIDTH - RIGHT];
      const [y1, y2] = axis === "y" ? [py(value), py(value)] : [TOP, HEIGHT - BOTTOM];
      drawing.append(svg("line", { x1, x2, y1, y2, class: "mark" }), svg("text", { x: x2 - 4, y: y1 + (axis === "x" ? 12 : -4), class: "quiet", "text-anchor": "end" }, label));
    });
    chosen.references.forEach((one) => drawing.append(svg("polyline", { points: points(one.x.map(px), one.y.map(py)), class: "reference" })));
    drawing.append(svg("polyline", { points: points(steps.map((step) => px(x[step])), steps.map((step) => py(y[step]))), class: "computed" }));
    for (const step of steps) {
      const dot = svg("circle", { cx: px(x[step]), cy: py(y[step]), r: 4.5, class: "dot", "data-step": step });
      dot.append(svg("title", {}, `step ${step}: ${show(x[step])}, ${show(y[step])}`));
      dot.onclick = () => this.go(step);
      drawing.append(dot);
    }
    this.#present(drawing, time, chosen, px, py);
    const names = chosen.references.map((one) => one.label);
    byId("curve-words").textContent = names.length ? `dashed: ${names.join("; ")}` : "";
  }

  // A ring at the present time, between two steps that are both on the curve.
  #present(drawing, time, { steps, x, y }, px, py) {
    const [start, end] = [Math.floor(time), Math.ceil(time)];
    if (!steps.includes(start) || !steps.includes(end)) return;
    const [cx, cy] = [x, y].map((list) => list[start] + (time - start) * (list[end] - list[start]));
    drawing.append(svg("circle", { cx: px(cx), cy: py(cy), r: 8, class: "present" }));
  }
}

const points = (x, y) => x.map((value, i) => `${value},${y[i]}`).join(" ");

// A linear scale from values to pixels, with zero where it is near, and round ticks.
function scale(list, from, to) {
  const finite = list.filter((value) => Number.isFinite(value));
  let [low, high] = [Math.min(...finite), Math.max(...finite)];
  if (!finite.length) [low, high] = [0, 1];
  if (low > 0 && low < 0.25 * high) low = 0;
  if (high < 0 && high > 0.25 * low) high = 0;
  if (!(high > low)) [low, high] = [low - (Math.abs(low) || 1), high + (Math.abs(high) || 1)];
  const raw = (high - low) / 4;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((size) => size * power >= raw);
  [low, high] = [Math.floor(low / step + 1e-9) * step, Math.ceil(high / step - 1e-9) * step];
  const map = (value) => from + ((value - low) / (high - low)) * (to - from);
  map.ticks = Array.from({ length: Math.round((high - low) / step) + 1 }, (_, i) => Number((low + i * step).toPrecision(12)));
  return map;
}

function axes(px, py, { xLabel, yLabel }) {
  const made = [];
  for (const tick of px.ticks) {
    made.push(svg("line", { x1: px(tick), x2: px(tick), y1: TOP, y2: HEIGHT - BOTTOM, class: "grid" }));
    made.push(svg("text", { x: px(tick), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, show(tick)));
  }
  for (const tick of py.ticks) {
    made.push(svg("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: py(tick), y2: py(tick), class: "grid" }));
    made.push(svg("text", { x: LEFT - 6, y: py(tick) + 4, "text-anchor": "end" }, show(tick)));
  }
  made.push(svg("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 10, "text-anchor": "middle" }, xLabel));
  const middle = (TOP + HEIGHT - BOTTOM) / 2;
  made.push(svg("text", { x: 14, y: middle, "text-anchor": "middle", transform: `rotate(-90 14 ${middle})` }, yLabel));
  return made;
}
