// The properties of fields: quantity, unit, panel, whether a field is constant, and whether it needs a logarithmic
// axis. Units are known for types of problems with SI units (bodies, circuits); in other problems they are the
// user's.

const MOST_IN_PANEL = 8;
const DECADES = 1e4; // ratio of the largest to the least positive value from which an axis is logarithmic
const MOST_DECADES = 1e12;
const SEEN = 200; // a curve can be seen beside another that is at most this many times as large
const FLAT = 1e-12; // a curve that varies by less than this fraction of its largest value is constant
const ROUNDING = 1e-12; // a field below this fraction of the largest field of its quantity is rounding

const OF_BODY = [
  [/\.(x|y|z)$/, "position", "m"],
  [/\.v(x|y|z)$/, "velocity", "m/s"],
  [/\.w(x|y|z)$/, "angular velocity", "rad/s"],
  [/\.q(w|x|y|z)$/, "orientation", ""],
  [/\.(contact_)?f(x|y|z)$|\.force$/, "force", "N"],
  [/\.(contact_)?t(x|y|z)$/, "torque", "N m"],
];
const ENERGY = [/_energy$|^dissipated_|^work_|^energy_/, "energy", "J"];

const RULES = {
  rigid_bodies: [...OF_BODY, ENERGY],
  circuit: [
    [/^v\(|^v_blocked\(/, "voltage", "V"],
    [/^i\(/, "current", "A"],
    [/^flux\(/, "flux linkage", "V s"],
    [/^charge\(/, "charge", "C"],
    [/^closed\(/, "switch closed", ""],
  ],
  mechanical: [
    [/_gap$/, "gap", ""],
    [/_impulse$/, "impulse", ""],
    [/_friction(_\d+)?$/, "friction impulse", ""],
    [/_energy$|^dissipated_|^energy_/, "energy", ""],
  ],
  elastic: [[/_energy$/, "energy", ""], [/^force_/, "contact force", ""]],
};

// Returns the type of the problem of a specification, such as `dvi` or `circuit`.
export const typeOf = (specification) => Object.keys(specification?.problem ?? {})[0] ?? "";

export const hasSeconds = (type) => type === "circuit" || type === "rigid_bodies";

// Returns {quantity, unit} of a field of the solution (a column of the trajectory).
export function describe(field, specification) {
  const type = typeOf(specification);
  for (const [pattern, quantity, unit] of RULES[type] ?? []) if (pattern.test(field)) return { quantity, unit };
  const problem = specification?.problem?.[type] ?? {};
  if (type === "mechanical" && field.endsWith("_dot")) return { quantity: "velocity", unit: "" };
  if (type === "mechanical" && Object.hasOwn(problem.coordinates ?? {}, field)) return { quantity: "coordinate", unit: "" };
  if (Object.hasOwn(problem.probes ?? {}, field)) return { quantity: type === "obstacle" ? "u" : "displacement", unit: "" };
  const vector = /^(.*?)\[.*\]$/.exec(field) ?? /^([A-Za-z_]+?)_?\d+$/.exec(field);
  return { quantity: vector ? vector[1] : field, unit: "", alone: !vector };
}

// Groups fields in panels: those of one quantity together, at most `MOST_IN_PANEL`, in their order, unless a field is
// so small beside another that its curve would lie on the axis. Coordinates and their rates are in different panels,
// as their quantities differ.
export function panels(fields, specification, sizeOf) {
  const groups = [];
  for (const field of fields) {
    const { quantity, unit, alone } = describe(field, specification);
    const size = sizeOf(field);
    const fits = (one) => size === 0 || one.size === 0 || (size < SEEN * one.size && one.size < SEEN * size);
    const open = alone ? null : groups.findLast((one) => one.quantity === quantity && one.fields.length < MOST_IN_PANEL && fits(one));
    if (open) [open.fields, open.size] = [[...open.fields, field], Math.max(open.size, size)];
    else groups.push({ quantity, unit, fields: [field], size });
  }
  return groups;
}

export function range(values) {
  let [least, largest] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < least) least = value;
    if (value > largest) largest = value;
  }
  return [least, largest];
}

export const isConstant = ([least, largest]) => largest - least <= FLAT * Math.max(Math.abs(least), Math.abs(largest));

// Whether the values of a field, within a range, are rounding errors compared with other fields of its quantity, whose
// size is `scale`.
export const isRounding = ([least, largest], scale) => Math.max(Math.abs(least), Math.abs(largest)) <= ROUNDING * scale;

// Whether a logarithmic axis can show a range of values: if the least value is rounding, the axis would show mainly
// rounding.
export const hasDecades = ([least, largest]) => least > 0 && largest / least <= MOST_DECADES;

export const wantsDecades = (found) => hasDecades(found) && found[1] / found[0] >= DECADES;

// Whether the times of a run, without a start at zero, cover decades evenly enough for a logarithmic axis.
export function wantsLogTime(t) {
  const positive = t.filter((time) => time > 0);
  if (positive.length < 10 || positive.at(-1) / positive[0] < DECADES) return false;
  const half = positive[positive.length >> 1];
  return half < positive.at(-1) / 50;
}
