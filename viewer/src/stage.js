// Renderer, camera and what moves it: mouse, touch and keys.
import { Color, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

const FIELD_OF_VIEW = 29; // degrees: the pictures' viewer stands 4 radii away
const TURN = 5; // degrees a key
const ZOOM = 1.15;
const ROOM = 1.3; // for arrows and their labels around the membrane

export class Stage {
  constructor(canvas, run, redraw) {
    const { head } = run;
    // The picture is kept so that it can be printed and read.
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.scene = new Scene();
    this.scene.background = new Color(0xffffff);
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, head.radius / 50, 50 * head.radius);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableZoom = false; // the wheel scrolls the page until the view is chosen
    this.head = head;
    this.run = run;
    this.placed = false;
    this.canvas = canvas;
    this.redraw = redraw;
    this.controls.addEventListener("change", redraw);
    canvas.addEventListener("pointerdown", () => canvas.focus());
    canvas.addEventListener("focus", () => (this.controls.enableZoom = true));
    canvas.addEventListener("blur", () => (this.controls.enableZoom = false));
    canvas.addEventListener("keydown", (event) => this.#key(event));
  }

  // The scene's view, as near as lets everything that the run shows stay in the picture.
  home() {
    const { run } = this;
    const [turn, lift] = [this.head.camera.azimuth, this.head.camera.elevation].map((degrees) => (degrees * Math.PI) / 180);
    const flat = Math.min(Math.abs(lift), Math.PI / 2 - 1e-3) * Math.sign(lift);
    const away = new Vector3(Math.cos(flat) * Math.sin(turn), -Math.cos(flat) * Math.cos(turn), Math.sin(flat));
    const right = new Vector3(0, 0, 1).cross(away).normalize();
    const [slopeUp, up] = [Math.tan((FIELD_OF_VIEW * Math.PI) / 360), away.clone().cross(right)];
    let distance = 0;
    const point = new Vector3();
    for (let step = 0; step < run.count; step++) {
      const move = run.move(step);
      for (let i = 0; i < move.length; i += 3) {
        point.set(run.rest[i] + move[i], run.rest[i + 1] + move[i + 1], run.rest[i + 2] + move[i + 2]);
        const aside = Math.max(Math.abs(point.dot(up)) / slopeUp, Math.abs(point.dot(right)) / (slopeUp * this.camera.aspect));
        distance = Math.max(distance, point.dot(away) + ROOM * aside);
      }
    }
    this.controls.target.set(0, 0, 0);
    this.camera.position.copy(away.multiplyScalar(distance));
    this.placed = true;
    this.controls.update();
    this.redraw();
  }

  #key(event) {
    const turns = { ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, TURN], ArrowDown: [0, -TURN] };
    const zooms = { "+": 1 / ZOOM, "=": 1 / ZOOM, "-": ZOOM };
    if (event.key in turns) this.#turn(...turns[event.key]);
    else if (event.key in zooms) this.#nearer(zooms[event.key]);
    else if (event.key === "Home") this.home();
    else return;
    event.preventDefault();
  }

  #turn(azimuth, elevation) {
    const away = this.camera.position.clone().sub(this.controls.target);
    const distance = away.length();
    const turn = Math.atan2(away.y, away.x) + (azimuth * Math.PI) / 180;
    const most = Math.PI / 2 - 1e-3;
    const lift = Math.max(-most, Math.min(most, Math.asin(away.z / distance) + (elevation * Math.PI) / 180));
    away.set(Math.cos(lift) * Math.cos(turn), Math.cos(lift) * Math.sin(turn), Math.sin(lift)).multiplyScalar(distance);
    this.camera.position.copy(this.controls.target).add(away);
    this.controls.update();
  }

  #nearer(factor) {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
  }

  // The view is placed when it first has a size; in a frame that is not shown (yet) it has none.
  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.placed) this.redraw();
    else this.home();
  }

  draw() {
    this.renderer.render(this.scene, this.camera);
  }

  // Pixels of a point in the view, from its upper left corner.
  project(point) {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    const at = new Vector3().copy(point).project(this.camera);
    return [((at.x + 1) / 2) * width, ((1 - at.y) / 2) * height];
  }
}
