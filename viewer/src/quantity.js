// What colours can show: the states, a field of the elements, or a vector of the nodes by size or component.
const COMPONENTS = ["size", "x", "y", "z"];

export function choices(head) {
  const list = [{ key: "state", title: "state: taut, wrinkled, slack", unit: "", kind: "state", note: "" }];
  head.fields.forEach((field, index) => list.push({ ...field, key: field.name, kind: "element", index }));
  head.vectors.forEach((vector, index) =>
    COMPONENTS.forEach((part, component) =>
      list.push({ ...vector, key: `${vector.name}.${part}`, title: `${vector.title}, ${part}`, kind: "node", index, component }),
    ),
  );
  return list;
}

export function pick(vector, component) {
  return component === 0 ? Math.hypot(...vector) : vector[component - 1];
}

// Values of all elements or nodes at a step; null where not finite.
export function values(run, choice, step) {
  if (choice.kind === "element") return Array.from({ length: run.head.element_count }, (_, k) => run.elementValue(choice.index, step, k));
  return Array.from({ length: run.head.node_count }, (_, i) => pick(run.nodeVector(choice.index, step, i), choice.component));
}

// Where a quantity is least and largest at a step. Of fields the page knows it from unrounded numbers; several elements may share a code.
export function extremes(run, choice, step) {
  const list = values(run, choice, step);
  if (choice.kind === "element") {
    const places = run.head.steps[step].extremes[choice.key];
    return places && { least: places[0], most: places[1], low: list[places[0]], high: list[places[1]] };
  }
  let [least, most] = [-1, -1];
  list.forEach((value, place) => {
    if (value === null) return;
    if (least < 0 || value < list[least]) least = place;
    if (most < 0 || value > list[most]) most = place;
  });
  return least < 0 ? null : { least, most, low: list[least], high: list[most] };
}

// Text of a number: five digits, no long rows of zeros.
export function show(value, unit = "") {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  const text = size !== 0 && (size < 1e-3 || size >= 1e6) ? value.toExponential(3) : String(Number(value.toPrecision(5)));
  return `${text.replaceAll("-", "−")}${unit ? ` ${unit}` : ""}`;
}
