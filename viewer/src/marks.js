// What is drawn beside the membrane: cables, supports, loads, wrinkle directions, the picked element and node.
import { BufferAttribute, BufferGeometry, ConeGeometry, CylinderGeometry, GLSL3, Group, LineBasicMaterial, LineLoop, LineSegments, Mesh, MeshBasicMaterial, Points, ShaderMaterial, Vector3 } from "three";
import { Cables } from "./cables.js";
import { normal } from "./data.js";

const WRINKLED = 1;
const LOAD = 0xa3123a;
const ALONG = new Vector3(0, 1, 0); // an arrow before it is turned

// Marks of one size in pixels: a triangle under the node (support), or a ring (picked node).
function pixelMarks(count, size, shape) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * count), 3));
  const material = new ShaderMaterial({
    glslVersion: GLSL3, transparent: true, depthTest: shape === "triangle",
    uniforms: { size: { value: size } },
    vertexShader: `uniform float size;
      void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); gl_Position.z -= 2e-3 * gl_Position.w; gl_PointSize = size; }`,
    fragmentShader: `out vec4 colour;
      void main() {
        vec2 p = 2.0 * gl_PointCoord - 1.0;
        ${shape === "triangle" ? "float d = p.y < 0.0 ? 1.0 : abs(p.x) - 0.6 * p.y;" : "float d = abs(length(p) - 0.75) - 0.16;"}
        if (d > 0.0) discard;
        colour = vec4(${shape === "triangle" ? "0.05, 0.36, 0.28" : "0.0, 0.35, 0.9"}, 1.0);
      }`,
  });
  const marks = new Points(geometry, material);
  marks.frustumCulled = false;
  return marks;
}

function lines(count, colour, kind = LineSegments, depthTest = true) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * count), 3));
  const drawn = new kind(geometry, new LineBasicMaterial({ color: colour, depthTest }));
  drawn.frustumCulled = false;
  return drawn;
}

// An arrow of length one along y, its tip at the origin.
function arrow() {
  const [shaft, head] = [new CylinderGeometry(0.018, 0.018, 0.74, 10).translate(0, -0.63, 0), new ConeGeometry(0.065, 0.26, 18).translate(0, -0.13, 0)];
  const seen = new MeshBasicMaterial({ color: LOAD });
  const hidden = new MeshBasicMaterial({ color: LOAD, transparent: true, opacity: 0.3, depthTest: false }); // shines through
  return new Group().add(...[seen, hidden].flatMap((material) => [new Mesh(shaft, material), new Mesh(head, material)]));
}

export class Marks {
  constructor(run, pixelRatio) {
    this.run = run;
    this.group = new Group();
    this.supports = pixelMarks(run.supports.length, 20 * pixelRatio, "triangle");
    this.wrinkles = lines(2 * run.marked.length, 0x20242c);
    this.element = lines(3, 0x0059e6, LineLoop, false);
    this.node = pixelMarks(1, 16 * pixelRatio, "ring");
    this.arrows = run.loads.map((nodes) => Array.from(nodes, arrow));
    this.cables = new Cables(run);
    this.group.add(this.cables.rods, this.supports, this.wrinkles, this.element, this.node, ...this.arrows.flat());
  }

  place(step, picked, shown) {
    const { run } = this;
    this.cables.place(step);
    this.supports.visible = shown.supports;
    run.supports.forEach((node, i) => this.#put(this.supports, i, this.#at(node)));
    this.#done(this.supports);
    this.#wrinkleLines(step, shown.directions);
    this.element.visible = picked.element !== null;
    this.node.visible = picked.node !== null;
    if (picked.element !== null) for (let c = 0; c < 3; c++) this.#put(this.element, c, this.#at(run.triangles[3 * picked.element + c]));
    if (picked.node !== null) this.#put(this.node, 0, this.#at(picked.node));
    this.#done(this.element);
    this.#done(this.node);
    this.#loadArrows(step, shown.loads);
  }

  // Tips stand at the loaded nodes; turned over where the factor is negative, gone where it is zero.
  #loadArrows(step, shown) {
    const { head } = this.run;
    head.loads.forEach((load, number) => {
      const factor = load.factors[step];
      const length = load.nodes.count > 1 ? 0.16 * head.radius : 0.34 * head.radius;
      const direction = new Vector3(...load.direction).normalize().multiplyScalar(Math.sign(factor) || 1);
      this.arrows[number].forEach((arrow, i) => {
        arrow.visible = shown && factor !== 0;
        const tip = this.#at(this.run.loads[number][i]);
        arrow.position.set(...tip);
        arrow.quaternion.setFromUnitVectors(ALONG, direction);
        arrow.scale.setScalar(length);
        arrow.userData.tail = new Vector3(...tip).addScaledVector(direction, -length);
      });
    });
  }

  // Where each acting load's label belongs: the tail of its first arrow.
  labels(step) {
    return this.run.head.loads.map((load, number) => ({ text: load.labels[step], at: this.arrows[number][0].userData.tail, shown: this.arrows[number][0].visible }));
  }

  // Lines along the major stress in the marked elements that are wrinkled.
  #wrinkleLines(step, shown) {
    const { run } = this;
    const { state, direction } = run.steps[step];
    let count = 0;
    if (shown) {
      for (const k of run.marked) {
        if (state[k] !== WRINKLED) continue;
        const [a, b, c] = [0, 1, 2].map((corner) => new Vector3(...this.#at(run.triangles[3 * k + corner])));
        const up = new Vector3(...normal([...a, ...b, ...c], 0, 3, 6)).normalize();
        const side = b.clone().sub(a).normalize();
        const angle = (direction[k] * Math.PI) / 256;
        const along = side.clone().multiplyScalar(Math.cos(angle)).addScaledVector(up.cross(side), Math.sin(angle)).multiplyScalar(run.head.wrinkle_marks.half_length);
        const middle = a.add(b).add(c).divideScalar(3);
        this.#put(this.wrinkles, count++, middle.clone().sub(along).toArray());
        this.#put(this.wrinkles, count++, middle.add(along).toArray());
      }
    }
    this.wrinkles.geometry.setDrawRange(0, count);
    this.#done(this.wrinkles);
    this.lineCount = count / 2;
  }

  #at(node) {
    return this.run.positions.subarray(3 * node, 3 * node + 3);
  }

  #put(drawn, place, point) {
    drawn.geometry.attributes.position.array.set(point, 3 * place);
  }

  #done(drawn) {
    drawn.geometry.attributes.position.needsUpdate = true;
  }
}
