// The page's viewer: binds the controls to the run.
import { Vector2 } from "three";
import { Curve } from "./curve.js";
import { load } from "./data.js";
import { drawLegend, drawOver } from "./furniture.js";
import { Marks } from "./marks.js";
import { drawNumbers } from "./numbers.js";
import { hit } from "./picking.js";
import { choices, extremes } from "./quantity.js";
import { Stage } from "./stage.js";
import { Surface, runRange } from "./surface.js";
import { byId } from "./svg.js";

const SECONDS_A_STEP = 0.6;
const CLICK = 4; // pixels the pointer may move and still click

class Viewer {
  constructor(run) {
    this.run = run;
    this.head = run.head;
    this.time = run.count - 1;
    this.exaggeration = 1;
    this.picked = { element: null, node: null };
    this.playing = false;
    this.choices = choices(run.head);
    this.choice = this.choices.find(({ key }) => key === run.head.field);
    this.curve = new Curve(run.head, (step) => this.go(step));
    this.#openView();
    this.#bind();
    this.go(this.time);
    this.stage?.resize();
  }

  get step() {
    return Math.round(this.time);
  }

  // Numbers and curve work where there is no WebGL, too.
  #openView() {
    try {
      this.stage = new Stage(byId("view"), this.run, () => this.draw());
    } catch {
      byId("no-view").hidden = false;
      return;
    }
    this.surface = new Surface(this.run);
    this.marks = new Marks(this.run, Math.min(2, devicePixelRatio));
    this.stage.scene.add(this.surface.mesh, this.marks.group);
  }

  #bind() {
    const field = byId("field");
    this.choices.forEach(({ key, title, unit }) => field.add(new Option(unit ? `${title} [${unit}]` : title, key, false, key === this.choice.key)));
    field.onchange = () => {
      this.choice = this.choices.find(({ key }) => key === field.value);
      this.refresh();
    };
    const slider = byId("step");
    slider.max = this.run.count - 1;
    slider.oninput = () => this.go(Number(slider.value));
    slider.onkeydown = (event) => this.#sliderKey(event);
    byId("play").onclick = () => (this.playing ? this.stop() : this.play());
    for (const id of ["directions", "mesh", "supports", "loads", "span"]) byId(id).onchange = () => this.refresh();
    byId("exaggeration").onchange = ({ target }) => {
      this.exaggeration = Number.isFinite(target.valueAsNumber) ? target.valueAsNumber : 1;
      this.go(this.time);
    };
    byId("home").onclick = () => this.stage?.home();
    for (const [id, kind, count] of [["element", "element", this.head.element_count], ["node", "node", this.head.node_count]]) {
      byId(id).max = count - 1;
      byId(id).onchange = ({ target }) => {
        const number = target.valueAsNumber;
        this.pick(kind, Number.isInteger(number) && number >= 0 && number < count ? number : null);
      };
    }
    for (const row of document.querySelectorAll("#steps tbody tr")) row.onclick = () => this.go(Number(row.dataset.step));
    if (this.stage) this.#bindView();
  }

  #bindView() {
    const view = byId("view");
    let down = [0, 0];
    view.addEventListener("pointerdown", ({ clientX, clientY }) => (down = [clientX, clientY]));
    view.addEventListener("pointerup", ({ clientX, clientY }) => {
      if (Math.hypot(clientX - down[0], clientY - down[1]) > CLICK) return;
      const box = view.getBoundingClientRect();
      const pointer = new Vector2((2 * (clientX - box.left)) / box.width - 1, 1 - (2 * (clientY - box.top)) / box.height);
      this.picked = hit(this.run, this.stage.camera, pointer) ?? { element: null, node: null };
      this.refresh();
    });
    new ResizeObserver(() => this.stage.resize()).observe(view.parentElement);
  }

  // The slider moves freely under the pointer, and from step to step by the keyboard.
  #sliderKey(event) {
    const moves = { ArrowRight: 1, ArrowUp: 1, PageUp: 1, ArrowLeft: -1, ArrowDown: -1, PageDown: -1 };
    const ends = { Home: 0, End: this.run.count - 1 };
    if (event.key in moves) this.go(this.step + moves[event.key]);
    else if (event.key in ends) this.go(ends[event.key]);
    else return;
    event.preventDefault();
  }

  pick(kind, number) {
    this.picked = { ...this.picked, [kind]: number };
    this.refresh();
  }

  go(time) {
    this.time = Math.max(0, Math.min(this.run.count - 1, time));
    byId("step").value = this.time;
    this.run.place(this.time, this.exaggeration);
    this.surface?.place(this.time, this.exaggeration);
    this.refresh();
  }

  // All that depends on step, field and pick.
  refresh() {
    const { step, choice, run } = this;
    const found = choice.kind === "state" ? null : extremes(run, choice, step);
    const range = choice.kind === "state" ? [0, 1] : byId("span").value === "step" && found ? [found.low, found.high] : runRange(run, choice);
    const shown = Object.fromEntries(["directions", "supports", "loads"].map((id) => [id, byId(id).checked]));
    if (this.surface) {
      this.surface.uniforms.meshLines.value = byId("mesh").checked;
      this.surface.paint(choice, range);
      this.marks.place(step, this.picked, shown);
    }
    drawLegend(this.head, choice, range, step, found, (kind, number) => this.pick(kind, number));
    byId("span").disabled = choice.kind === "state";
    drawNumbers(run, step, this.picked);
    for (const kind of ["element", "node"]) byId(kind).value = this.picked[kind] ?? "";
    this.curve.draw(this.time);
    byId("step-words").textContent = this.head.steps[step].words;
    byId("step").setAttribute("aria-valuetext", this.head.steps[step].words);
    for (const row of document.querySelectorAll("tr[data-step]")) row.classList.toggle("present", Number(row.dataset.step) === step);
    this.draw();
  }

  draw() {
    if (!this.stage?.placed) return;
    this.stage.draw();
    drawOver(this.stage, this.marks, this.head, this.step);
  }

  play() {
    this.#playing(true);
    let time = this.time >= this.run.count - 1 ? 0 : this.time;
    let before = performance.now();
    const frame = (now) => {
      if (!this.playing) return;
      time += (now - before) / (1000 * SECONDS_A_STEP);
      before = now;
      this.go(time);
      if (time < this.run.count - 1) requestAnimationFrame(frame);
      else this.#playing(false);
    };
    requestAnimationFrame(frame);
  }

  stop() {
    this.#playing(false);
    this.go(this.step);
  }

  #playing(on) {
    this.playing = on;
    byId("play").textContent = on ? "Stop" : "Play";
  }
}

const head = JSON.parse(byId("head").textContent);
load(head, byId("data").textContent).then(
  (run) => {
    window.viewer = new Viewer(run);
    document.body.dataset.ready = "yes";
  },
  (error) => {
    byId("no-view").hidden = false;
    byId("no-view").textContent = `The numbers of this page could not be unpacked: ${error.message}`;
    throw error;
  },
);
