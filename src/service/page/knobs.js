// A slider (knob) for every adjustable number of a problem: parameters, initial values, and if there are none of
// these the values of components, masses and coefficients.
//
// A slider writes its number into the text of the specification, in place of the old number: the text is the only
// state, and undo restores it.

import { element } from "./element.js";
import { value as valueOf } from "./expressions.js";
import { number } from "./numbers.js";

const SIGNIFICANT = 5; // significant digits of a number that a slider writes
const STEPS = 400;
const MOST = 60; // largest number of sliders

// Matches JSON pointers to numbers of a specification that are not quantities: sizes, indices, orders.
const STRUCTURE = /\/(elements|triangles|orientation|normal|axis|count|nodes|mass\/\d+|[ABCD]|tables|domain|vertices|points)(\/|$)/;
const START = /\/(initial|(coordinates|bodies)\/[^/]+\/(velocity|angular_velocity|position)|(capacitor\/volts|inductor\/amperes))(\/\d+)?$/;

// Returns the numbers of a specification that sliders can change: {pointer, name, value, start} for each.
export function knobsOf(specification) {
  const problem = specification?.problem;
  if (problem === null || typeof problem !== "object") return [];
  const [type] = Object.keys(problem);
  const found = [];
  const visit = (value, pointer, name) => {
    if (found.length >= MOST) return;
    if (typeof value === "number" || (typeof value === "string" && isConstant(pointer, value))) {
      const shown = typeof value === "number" ? value : valueOf(value);
      if (!STRUCTURE.test(pointer) && Number.isFinite(shown)) found.push({ pointer, name, value: shown, start: START.test(pointer), declared: pointer.includes("/parameters/") });
    } else if (Array.isArray(value)) {
      const isVector = value.length <= 3 && value.every((one) => typeof one !== "object");
      value.forEach((one, i) => visit(one, `${pointer}/${i}`, `${name} ${isVector ? "xyz"[i] : (one?.name ?? Object.values(one ?? {})[0]?.name ?? i + 1)}`));
    } else if (value !== null && typeof value === "object") {
      for (const [key, one] of Object.entries(value)) visit(one, `${pointer}/${escaped(key)}`, joined(name, key));
    }
  };
  const inner = problem[type] ?? {};
  visit(inner.parameters ?? {}, `/problem/${type}/parameters`, "");
  for (const [key, value] of Object.entries(inner)) {
    if (!["parameters", "label", "netlist", "definitions", "integrals"].includes(key)) visit(value, `/problem/${type}/${key}`, key);
  }
  if (type === "circuit" && typeof inner.netlist === "string") found.push(...ofNetlist(inner.netlist));
  return found.slice(0, MOST);
}

const SUFFIXES = { t: 1e12, g: 1e9, meg: 1e6, k: 1e3, m: 1e-3, u: 1e-6, n: 1e-9, p: 1e-12, f: 1e-15 };

// Returns the values in the lines of a netlist that sliders can change. A line that a slider changes has its number
// without a unit suffix.
function ofNetlist(netlist) {
  const line = /^([RCLVI]\S*)(\s+\S+\s+\S+\s+)(\d+\.?\d*(?:e[+-]?\d+)?)(meg|[tgkmunpf])?(?=\s|$)/gim;
  return [...netlist.matchAll(line)].map((match) => {
    const [whole, name, nodes, digits, suffix] = match;
    const from = match.index + name.length + nodes.length;
    return {
      pointer: `/problem/circuit/netlist#${name}`,
      name,
      value: Number((Number(digits) * (SUFFIXES[suffix?.toLowerCase()] ?? 1)).toPrecision(12)),
      start: false,
      declared: true,
      put: (value) => ["/problem/circuit/netlist", netlist.slice(0, from) + String(value) + netlist.slice(match.index + whole.length)],
    };
  });
}

// Whether a slider can change a string: it is a constant expression in place of a quantity, such as "2*pi" of a
// parameter.
const isConstant = (pointer, text) => /\/(parameters|initial)\//.test(`${pointer}/`) && text.length < 40 && /\d|pi/.test(text) && Number.isFinite(valueOf(text));

const escaped = (key) => key.replaceAll("~", "~0").replaceAll("/", "~1");

const PLAIN = new Set(["states", "initial", "coordinates", "components", "bodies", "rate", "body", "shape", "joints"]);

const joined = (name, key) => {
  const words = name.split(" ").filter((word) => word !== "" && !PLAIN.has(word) && !KINDS.has(word));
  return [...words, ...(key === "initial" ? ["(0)"] : [key])].join(" ").replace(" (0)", "(0)");
};

const KINDS = new Set(["sphere", "box", "capsule", "cylinder", "hinge", "ball", "slider", "resistor", "capacitor", "inductor", "voltage_source", "current_source", "diode", "zener", "switch", "op_amp", "comparator", "transformer"]);

// Returns the initial range of a slider: up to twice a positive number, and both signs for an initial value.
export function guessedRange({ value, start }) {
  if (value === 0) return [-1, 1];
  const size = Number(Math.abs(value).toPrecision(2));
  if (start) return [-2 * size, 2 * size];
  return value > 0 ? [0, 2 * size] : [-2 * size, 0];
}

// Returns the name that a parameter sweep has for a number of a specification; null if it has none, as for components
// of a netlist and single numbers of vectors.
export function nameInSweep({ pointer }, specification) {
  const parts = pointer.split("/").slice(1).map((part) => part.replaceAll("~1", "/").replaceAll("~0", "~"));
  const [, type, section, name, key] = parts;
  if (pointer.includes("#") || name?.includes("[") || parts.length > 6) return null;
  const problem = specification.problem[type];
  if (section === "parameters" && parts.length === 4) return name;
  if ((section === "states" || section === "coordinates") && parts.length === 5) return `${name}.${key}`;
  if (type === "lcs" && section === "initial") return `${problem.state_names?.[name] ?? `x${Number(name) + 1}`}.initial`;
  if (/^\d+$/.test(parts.at(-1))) return null;
  const item = problem[section]?.[name];
  const named = item?.[key]?.name ?? item?.name;
  return Array.isArray(problem[section]) && typeof named === "string" ? `${named}.${parts.at(-1)}` : null;
}

export const rounded = (value) => Number(value.toPrecision(SIGNIFICANT));

export class Knobs {
  #root;
  #turned;
  #rows = new Map(); // the rows of the sliders: pointer to {knob, slider, told (shows the number), low, high}

  // `turned(pointer, value, done)` is called with each new value of a slider; `done` is true when the slider is
  // released.
  constructor(root, turned) {
    this.#root = root;
    this.#turned = turned;
  }

  get count() {
    return this.#rows.size;
  }

  // Returns all numbers that have a slider, with the ranges of their sliders.
  get list() {
    return [...this.#rows.values()].map(({ knob, low, high }) => ({ ...knob, low, high }));
  }

  // Shows the sliders of a specification. Sliders that were there before keep their range and their focus.
  show(specification) {
    const knobs = knobsOf(specification);
    const same = knobs.length === this.#rows.size && knobs.every((knob) => this.#rows.has(knob.pointer));
    if (same) {
      for (const knob of knobs) this.#update(this.#rows.get(knob.pointer), knob);
      return;
    }
    this.#rows = new Map();
    const rows = (list) => element("div", { class: "knobs" }, ...list.map((knob) => this.#row(knob)));
    const group = (title, list) => (list.length === 0 ? [] : [element("h2", { class: "part-title" }, title), rows(list)]);
    const declared = knobs.filter((knob) => knob.declared);
    const starts = knobs.filter((knob) => knob.start && !knob.declared);
    const others = knobs.filter((knob) => !knob.start && !knob.declared);
    const folded = others.length === 0 ? [] : [element("details", { open: declared.length === 0 }, element("summary", {}, "Other numbers"), rows(others))];
    this.#root.replaceChildren(...group("Parameters", declared), ...group("Initial values", starts), ...folded);
  }

  #update(row, knob) {
    row.knob = knob;
    if (Number(row.slider.dataset.value) === knob.value) return;
    if (knob.value < row.low || knob.value > row.high) [row.low, row.high] = guessedRange(knob);
    this.#place(row, knob.value);
  }

  #place(row, value) {
    const { slider, told, from, to, low, high } = row;
    slider.min = low;
    slider.max = high;
    slider.step = (high - low) / STEPS || "any";
    slider.value = value;
    slider.dataset.value = value;
    [from.value, to.value] = [low, high];
    told.textContent = number(value);
  }

  #row(knob) {
    const [low, high] = guessedRange(knob);
    const told = element("output", { class: "told" });
    const slider = element("input", { type: "range", "aria-label": knob.name, "data-pointer": knob.pointer });
    const bound = (name) => element("input", { type: "number", step: "any", class: "bound", "aria-label": `${name} of ${knob.name}` });
    const row = { knob, slider, told, from: bound("least value"), to: bound("largest value"), low, high };
    const turn = (done) => {
      const value = rounded(Number(slider.value));
      slider.dataset.value = value;
      told.textContent = number(value);
      const [pointer, written] = row.knob.put?.(value) ?? [knob.pointer, value];
      this.#turned(pointer, written, done);
    };
    slider.addEventListener("input", () => turn(false));
    slider.addEventListener("change", () => turn(true));
    for (const [input, end] of [[row.from, "low"], [row.to, "high"]]) {
      input.addEventListener("change", () => {
        const wanted = Number(input.value);
        const fits = input.value !== "" && (end === "low" ? wanted < row.high : wanted > row.low);
        if (fits) row[end] = wanted;
        this.#place(row, Number(slider.dataset.value));
      });
    }
    this.#rows.set(knob.pointer, row);
    this.#place(row, knob.value);
    return element(
      "div",
      { class: "knob" },
      element("span", { class: "name", title: `${knob.name}: ${knob.pointer}` }, knob.name),
      told,
      row.from,
      slider,
      row.to,
    );
  }
}
