// Which element a line of sight meets first, and which of its corners is nearest to the point.
import { Raycaster, Vector3 } from "three";

export function hit(run, camera, pointer) {
  const caster = new Raycaster();
  caster.setFromCamera(pointer, camera);
  const { ray } = caster;
  const { positions, triangles } = run;
  const corners = [new Vector3(), new Vector3(), new Vector3()];
  const found = new Vector3();
  let [element, least, point] = [null, Infinity, new Vector3()];
  for (let k = 0; k < triangles.length / 3; k++) {
    corners.forEach((corner, c) => corner.fromArray(positions, 3 * triangles[3 * k + c]));
    if (!ray.intersectTriangle(...corners, false, found)) continue;
    const distance = found.distanceToSquared(ray.origin);
    if (distance < least) [element, least, point] = [k, distance, found.clone()];
  }
  if (element === null) return null;
  const distances = [0, 1, 2].map((c) => point.distanceToSquared(new Vector3().fromArray(positions, 3 * triangles[3 * element + c])));
  return { element, node: triangles[3 * element + distances.indexOf(Math.min(...distances))] };
}
