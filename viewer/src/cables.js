// Cables as thin rods in the colours of their forces at the nearest step; slack ones thinner and grey.
import { Color, CylinderGeometry, InstancedMesh, Matrix4, MeshBasicMaterial, Quaternion, Vector3 } from "three";
import { html } from "./svg.js";
import { show } from "./quantity.js";

const [THICK, SLACK] = [0.006, 0.003]; // radii over that of all that is shown
const GREY = [115, 115, 115];
const ALONG = new Vector3(0, 1, 0); // a rod before it is turned

// Its place on the ramp, 0 to 1; of one force alone the middle.
const level = ({ low, high }, force) => (high > low ? (force - low) / (high - low) : 0.5);

export class Cables {
  constructor(run) {
    this.run = run;
    this.count = run.cables.length / 2;
    this.rods = new InstancedMesh(new CylinderGeometry(1, 1, 1, 8), new MeshBasicMaterial(), Math.max(this.count, 1));
    this.rods.count = this.count;
    this.rods.frustumCulled = false;
  }

  colour(step, number) {
    const { ramp } = this.run.head.cables;
    const force = this.run.steps[step].cableForce[number];
    return force === 0 ? GREY : ramp[Math.round(level(this.run.head.cables, force) * (ramp.length - 1))];
  }

  place(step) {
    const { run, rods } = this;
    const at = (node) => new Vector3(...run.positions.subarray(3 * node, 3 * node + 3));
    for (let k = 0; k < this.count; k++) {
      const [a, b] = [at(run.cables[2 * k]), at(run.cables[2 * k + 1])];
      const along = b.clone().sub(a);
      const radius = run.head.radius * (run.steps[step].cableForce[k] === 0 ? SLACK : THICK);
      const turn = new Quaternion().setFromUnitVectors(ALONG, along.clone().normalize());
      rods.setMatrixAt(k, new Matrix4().compose(a.add(b).divideScalar(2), turn, new Vector3(radius, along.length(), radius)));
      rods.setColorAt(k, new Color(`rgb(${this.colour(step, k)})`));
    }
    rods.instanceMatrix.needsUpdate = true;
    if (rods.instanceColor) rods.instanceColor.needsUpdate = true;
  }
}

// What the colours of cables mean, after the legend of the surface; nothing where there are no cables.
export function cableLegend(legend, { cables, units }) {
  if (!cables.count) return;
  const swatch = (rgb) => {
    const made = html("i", "", "swatch");
    made.style.background = `rgb(${rgb})`;
    return made;
  };
  const row = html("span", "", "entry cables");
  if (cables.low !== null) row.append("cables: ", swatch(cables.ramp[0]), `${show(cables.low)} to `, swatch(cables.ramp.at(-1)), `${show(cables.high)} ${units.force}, `);
  row.append(swatch(GREY), "slack cable");
  legend.append(row);
}
