// The picture of a circuit as a ladder: nodes are rails, ground the lowest, and components stand between the rails of
// their nodes. It is drawn from the netlist alone, for any circuit, without crossings that could be read as
// junctions. Dots move with the currents; rails have the colour of their voltage; conducting components are lit.

import { film } from "./film.js";
import { nearestTo } from "../plots.js";
import { number } from "../numbers.js";
import { dot, line, surface } from "./surface.js";

const FRAMES = 401;
const MOST = 40; // largest number of components that are drawn
const ROW = 74; // pixels between rails
const DOTS = 22; // pixels between the dots of a current

const KINDS = { R: "resistor", C: "capacitor", L: "inductor", V: "voltage_source", I: "current_source", D: "diode", S: "switch", E: "voltage_source", H: "voltage_source", G: "current_source", F: "current_source", Z: "zener" };

// Returns the components of a circuit: {kind, name, nodes, note}.
export function componentsOf(circuit) {
  if (typeof circuit.netlist === "string") return fromNetlist(circuit.netlist);
  return (circuit.components ?? []).flatMap((component) => {
    const [kind, given] = Object.entries(component)[0] ?? [];
    if (!given) return [];
    if (kind === "transformer") {
      return [
        { kind: "winding", name: `${given.name}.primary`, nodes: given.primary, note: "" },
        { kind: "winding", name: `${given.name}.secondary`, nodes: given.secondary, note: "" },
      ];
    }
    const nodes = given.nodes ?? (given.output !== undefined ? [given.output, "0"].flat().slice(0, 2) : null);
    if (!Array.isArray(nodes) || nodes.length !== 2) return [];
    const size = given.ohms ?? given.farads ?? given.henries ?? given.volts ?? given.amperes;
    return [{ kind, name: given.name, nodes: nodes.map(String), note: noteOf(kind, size), inputs: given.inputs }];
  });
}

const UNITS = { resistor: "Ω", capacitor: "F", inductor: "H", voltage_source: "V", current_source: "A" };
const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]];

function noteOf(kind, size) {
  if (typeof size === "string") return size.length > 14 ? "" : size;
  if (typeof size !== "number" || !UNITS[kind]) return "";
  if (size === 0) return `0 ${UNITS[kind]}`;
  const [factor, prefix] = PREFIXES.find(([factor]) => Math.abs(size) >= factor * 0.9999) ?? PREFIXES.at(-1);
  return `${number(size / factor, 4)} ${prefix}${UNITS[kind]}`;
}

function fromNetlist(text) {
  const joined = text.replaceAll(/\r?\n\+/g, " ");
  return joined.split(/\r?\n/).flatMap((row) => {
    const [name, first, second, ...rest] = row.replace(/;.*/, "").trim().split(/\s+/);
    const kind = KINDS[name?.[0]?.toUpperCase()];
    if (!kind || name.startsWith("*") || second === undefined) return [];
    return [{ kind, name, nodes: [first, second].map((node) => (/^gnd$/i.test(node) ? "0" : node)), note: rest[0] && rest[0].length < 10 ? rest[0] : "" }];
  });
}

export function needs(specification) {
  const components = componentsOf(specification.problem.circuit);
  if (components.length === 0 || components.length > MOST) return null;
  const fields = [...components.map(({ name }) => `i(${name})`), ...nodesOf(components).filter((node) => node !== "0").map((node) => `v(${node})`)];
  return { ...film(specification), output: { times: { count: FRAMES }, fields } };
}

const nodesOf = (components) => [...new Set(components.flatMap(({ nodes }) => nodes))];

// Returns the nodes of a circuit in the order of their rails from the top, ground last: a node is near those to which
// it is joined.
function railsOf(components) {
  const nodes = nodesOf(components).filter((node) => node !== "0");
  const order = [];
  const queue = components.filter(({ kind }) => kind === "voltage_source" || kind === "current_source").flatMap(({ nodes }) => nodes);
  for (const start of [...queue, ...nodes]) {
    const open = [start];
    while (open.length > 0) {
      const node = open.shift();
      if (node === "0" || order.includes(node)) continue;
      order.push(node);
      for (const { nodes: ends } of components) {
        if (ends.includes(node) && !ends.includes("0")) open.push(...ends.filter((one) => one !== node));
      }
    }
  }
  return [...order, ...(components.some(({ nodes }) => nodes.includes("0")) ? ["0"] : [])];
}

export function make(specification, run, { canvas: standing } = {}) {
  const components = componentsOf(specification.problem.circuit);
  const rails = railsOf(components);
  // Components of the circuit are sorted by their upper rails, so that rails stay short.
  const rank = (component) => component.nodes.map((node) => rails.indexOf(node)).sort((a, b) => a - b);
  const columns = [...components].sort((a, b) => rank(a)[0] - rank(b)[0] || rank(a)[1] - rank(b)[1]);
  const current = (component) => run.fields[`i(${component.name})`];
  const largest = Math.max(...columns.map((one) => percentile(current(one) ?? [])), 1e-300);
  const volts = rails.map((node) => run.fields[`v(${node})`]);
  const highest = Math.max(...volts.flatMap((column) => (column ? [percentile(column)] : [])), 1e-300);
  const travelled = columns.map((component) => charge(run.t, current(component)));
  const whole = Math.max(...travelled.map((column) => (column ? Math.max(...column.map(Math.abs)) : 0)), 1e-300);
  let time = run.t[0];

  const paint = (context, { width, colour }) => {
    const k = nearestTo(run.t, time);
    const step = Math.min(92, (width - 120) / Math.max(1, columns.length - 1));
    const left = 70;
    const x = (place) => left + place * step;
    const y = (node) => 30 + rails.indexOf(node) * ROW;
    rails.forEach((node, place) => {
      const at = columns.flatMap((one, i) => (one.nodes.includes(node) ? [x(i)] : []));
      const v = volts[place]?.[k] ?? 0;
      const shade = node === "0" ? colour("--ink") : railColour(v / highest, colour);
      line(context, [[Math.min(...at), y(node)], [Math.max(...at), y(node)]], shade, 3);
      at.forEach((one) => dot(context, one, y(node), 3, shade));
      context.fillStyle = colour("--ink");
      context.textAlign = "right";
      context.fillText(node === "0" ? "ground" : `${node}  ${number(v, 3)} V`, Math.min(...at) - 8 < 62 ? 62 : Math.min(...at) - 8, y(node) - 5);
    });
    columns.forEach((component, i) => {
      const [from, to] = component.nodes.map(y);
      const i0 = current(component)?.[k] ?? 0;
      const flows = Math.abs(i0) > 1e-6 * largest;
      const ink = flows ? colour("--accent") : colour("--quiet");
      // A component stands between the rails of two nodes, never on a rail that its wire passes.
      const rows = Math.abs(to - from) / ROW;
      const middle = Math.min(from, to) + ROW * (Math.ceil(rows / 2) - 0.5);
      const half = 22;
      const down = to > from ? 1 : -1;
      line(context, [[x(i), from], [x(i), middle - down * half]], ink, 1.6);
      line(context, [[x(i), middle + down * half], [x(i), to]], ink, 1.6);
      symbol(context, component, x(i), middle, half, down, ink, flows, colour);
      context.textAlign = "left";
      context.fillStyle = colour("--ink");
      context.fillText(component.name, x(i) + 15, middle - 2);
      context.fillStyle = colour("--quiet");
      if (component.note && step > 60) context.fillText(component.note, x(i) + 15, middle + 12);
      // The dots of a component move by the charge that has passed, so that their speed is proportional to the current.
      if (!flows || !travelled[i]) return;
      const shift = ((travelled[i][k] / whole) * 60 * DOTS) % DOTS;
      const length = Math.abs(to - from);
      for (let s = ((shift % DOTS) + DOTS) % DOTS; s < length; s += DOTS) {
        dot(context, x(i), from + down * s, 1.5 + 2 * Math.min(1, Math.abs(i0) / largest), colour("--flow"));
      }
    });
  };
  const { canvas, redraw, dispose } = surface("The circuit, with its currents at the time of the cursor", 60 + (rails.length - 1) * ROW, paint, standing);
  const draw = (at) => {
    time = at;
    redraw();
  };
  return { element: canvas, draw, dispose, hint: "Rails are nodes, red above ground and blue below; dots move with the current; conducting components are coloured." };
}

// Returns the charge that has passed through a component at each time, by the trapezoidal rule.
function charge(t, current) {
  if (!current) return null;
  const passed = [0];
  for (let k = 1; k < t.length; k += 1) passed.push(passed[k - 1] + ((t[k] - t[k - 1]) * (current[k] + current[k - 1])) / 2);
  return passed;
}

// Returns a large absolute value of a column that is not a single spike: the 98th percentile.
function percentile(column) {
  const sizes = Float64Array.from(column, Math.abs).sort();
  return sizes[Math.floor(0.98 * (sizes.length - 1))] ?? 0;
}

function railColour(part, colour) {
  const size = Math.round(100 * Math.min(1, Math.abs(part)));
  return `color-mix(in srgb, ${colour(part >= 0 ? "--hot" : "--cold")} ${size}%, ${colour("--quiet")})`;
}

function symbol(context, { kind, inputs }, x, y, half, down, ink, flows, colour) {
  context.strokeStyle = ink;
  context.lineWidth = 1.8;
  const stroke = (points) => line(context, points, ink, 1.8);
  const paper = colour("--paper-hex");
  switch (kind) {
    case "resistor":
      context.strokeRect(x - 7, y - half, 14, 2 * half);
      break;
    case "capacitor":
      stroke([[x, y - half], [x, y - 4]]);
      stroke([[x, y + 4], [x, y + half]]);
      stroke([[x - 12, y - 4], [x + 12, y - 4]]);
      stroke([[x - 12, y + 4], [x + 12, y + 4]]);
      break;
    case "inductor":
    case "winding":
      for (let k = 0; k < 4; k += 1) {
        context.beginPath();
        context.arc(x, y - half + (half / 4) * (2 * k + 1), half / 4, -Math.PI / 2, Math.PI / 2);
        context.stroke();
      }
      break;
    case "diode":
    case "zener": {
      const tip = y + down * half * 0.5;
      const back = y - down * half * 0.5;
      stroke([[x, y - half], [x, y + half]]);
      context.fillStyle = flows ? colour("--lit") : paper;
      context.beginPath();
      context.moveTo(x - 10, back);
      context.lineTo(x + 10, back);
      context.lineTo(x, tip);
      context.closePath();
      context.fill();
      context.stroke();
      stroke(kind === "zener" ? [[x - 10, tip + 4], [x - 10, tip], [x + 10, tip], [x + 10, tip - 4]] : [[x - 10, tip], [x + 10, tip]]);
      break;
    }
    case "switch":
      stroke([[x, y - half], [x, y - 10]]);
      stroke([[x, y + 10], [x, y + half]]);
      stroke(flows ? [[x, y - 10], [x, y + 10]] : [[x, y + 10], [x + 12, y - 8]]);
      dot(context, x, y - 10, 2.5, ink);
      dot(context, x, y + 10, 2.5, ink);
      break;
    default:
      stroke([[x, y - half], [x, y - 12]]);
      stroke([[x, y + 12], [x, y + half]]);
      context.beginPath();
      context.arc(x, y, 12, 0, 2 * Math.PI);
      context.stroke();
      context.fillStyle = ink;
      context.textAlign = "center";
      if (inputs) context.fillText("±", x, y + 4);
      else if (kind === "current_source") {
        const tip = y + down * 7;
        stroke([[x, y - down * 7], [x, tip]]);
        stroke([[x - 4, tip - down * 5], [x, tip], [x + 4, tip - down * 5]]);
      } else {
        context.fillText("+", x, y - down * 5 + 4);
        context.fillText("–", x, y + down * 6 + 4);
      }
  }
}
