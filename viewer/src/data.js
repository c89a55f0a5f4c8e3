// Numbers of the run as the page holds them: fields by step, positions at any time between two steps.
import { inflate, unpack } from "./unpack.js";

const MISSING = 65535; // code of a value that is not finite

export async function load(head, text) {
  const bytes = await inflate(text);
  const array = (entry) => unpack(bytes, entry);
  const steps = head.steps.map((step) => ({
    state: array(step.state),
    cableForce: array(step.cable_force),
    direction: array(step.direction),
    tautMargin: array(step.taut_margin),
    slackMargin: array(step.slack_margin),
    fields: head.fields.map((field) => array(step.fields[field.name])),
    vectors: head.vectors.map((vector) => ({ scale: step.vectors[vector.name].scale, codes: array(step.vectors[vector.name].codes) })),
  }));
  const rest = byNode(array(head.points), head.node_count);
  const groups = (list) => list.map(({ name, members }) => ({ name, members: new Set(array(members)) }));
  return new Run(head, steps, {
    rest,
    triangles: array(head.triangles),
    cables: array(head.cables.nodes),
    supports: array(head.supports),
    marked: array(head.wrinkle_marks.elements),
    loads: head.loads.map((load) => array(load.nodes)),
    held: head.vectors.map((vector) => (vector.nodes ? new Map([...array(vector.nodes)].map((node, place) => [node, place])) : null)),
    nodeGroups: groups(head.node_groups),
    elementGroups: groups(head.element_groups),
  });
}

// Stored x of all nodes, then y, then z; used node by node.
function byNode(columns, count) {
  const rows = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) for (let c = 0; c < 3; c++) rows[3 * i + c] = columns[c * count + i];
  return rows;
}

export class Run {
  constructor(head, steps, arrays) {
    Object.assign(this, arrays);
    this.head = head;
    this.steps = steps;
    this.count = steps.length;
    this.positions = new Float32Array(this.rest.length);
    this.moves = steps.map(() => null);
  }

  // Displacement of every node at a step, (3 n).
  move(step) {
    if (!this.moves[step]) {
      const { scale, codes } = this.steps[step].vectors[0];
      this.moves[step] = byNode(codes, this.head.node_count).map((code) => code * scale);
    }
    return this.moves[step];
  }

  // The steps on both sides of a time, and how far it is from the first to the second.
  between(time) {
    const start = Math.min(Math.floor(time), Math.max(this.count - 2, 0));
    return { start, end: Math.min(start + 1, this.count - 1), share: this.count > 1 ? time - start : 0 };
  }

  place(time, exaggeration) {
    const { start, end, share } = this.between(time);
    const [a, b] = [this.move(start), this.move(end)];
    for (let i = 0; i < this.rest.length; i++) this.positions[i] = this.rest[i] + exaggeration * (a[i] + share * (b[i] - a[i]));
  }

  // Normals of the nodes at a step, means of the elements around weighted by area.
  normals(step, exaggeration) {
    const [x, u, t] = [this.rest, this.move(step), this.triangles];
    const at = x.map((value, i) => value + exaggeration * u[i]);
    const sum = new Float32Array(x.length);
    for (let k = 0; k < t.length; k += 3) {
      const n = normal(at, 3 * t[k], 3 * t[k + 1], 3 * t[k + 2]);
      for (let corner = 0; corner < 3; corner++) for (let c = 0; c < 3; c++) sum[3 * t[k + corner] + c] += n[c];
    }
    return sum;
  }

  // Value of an element's field; null where it is not finite.
  elementValue(field, step, element) {
    const code = this.steps[step].fields[field][element];
    const { low, high } = this.head.fields[field];
    return code === MISSING ? null : low + ((high - low) * code) / (MISSING - 1);
  }

  // A node's vector; zero where the page holds none (no support, no reaction).
  nodeVector(vector, step, node) {
    const { scale, codes } = this.steps[step].vectors[vector];
    const held = this.held[vector];
    const place = held ? held.get(node) : node;
    const count = held ? held.size : this.head.node_count;
    return place === undefined ? [0, 0, 0] : [0, 1, 2].map((c) => codes[c * count + place] * scale);
  }

  groupsOf(list, number) {
    return list.filter(({ members }) => members.has(number)).map(({ name }) => name);
  }
}

// Twice the directed area of a triangle whose corners begin at three places of a list of coordinates.
export function normal(at, i, j, k) {
  const [ax, ay, az] = [at[j] - at[i], at[j + 1] - at[i + 1], at[j + 2] - at[i + 2]];
  const [bx, by, bz] = [at[k] - at[i], at[k + 1] - at[i + 1], at[k + 2] - at[i + 2]];
  return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
}
