// Tables of all numbers of the picked element and node.
import { byId, html } from "./svg.js";
import { choices, pick, show } from "./quantity.js";

export function drawNumbers(run, step, picked) {
  const { head } = run;
  const place = byId("numbers");
  place.replaceChildren();
  if (picked.element !== null) {
    const rows = [["state", head.states[run.steps[step].state[picked.element]]]];
    head.fields.forEach((field, index) => rows.push([field.title, show(run.elementValue(index, step, picked.element), field.unit)]));
    rows.push(["nodes", Array.from(run.triangles.subarray(3 * picked.element, 3 * picked.element + 3)).join(", ")]);
    rows.push(["groups", run.groupsOf(run.elementGroups, picked.element).join(", ") || "none"]);
    place.append(table(`Element ${picked.element}`, rows));
  }
  if (picked.node !== null) {
    const rows = choices(head).filter(({ kind }) => kind === "node").map(({ title, unit, index, component }) => [title, show(pick(run.nodeVector(index, step, picked.node), component), unit)]);
    const at = [0, 1, 2].map((c) => show(run.rest[3 * picked.node + c] + head.centre[c]));
    rows.push(["position at rest", `${at.join(", ")} ${head.units.length}`]);
    rows.push(["groups", run.groupsOf(run.nodeGroups, picked.node).join(", ") || "none"]);
    place.append(table(`Node ${picked.node}`, rows));
  }
}

function table(caption, rows) {
  const made = html("table", "", "numbers");
  made.append(html("caption", caption));
  for (const [name, value] of rows) {
    const row = document.createElement("tr");
    const head = html("th", name);
    head.scope = "row";
    row.append(head, html("td", value));
    made.append(row);
  }
  return made;
}
