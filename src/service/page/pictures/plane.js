// The picture of a system in a plane, as its `view` describes it: points as expressions, some with a radius, and
// segments between them. Without a view, a mechanical system is shown by bars for its gaps. A contact flashes at an
// impact and stays lit while it is closed.

import { compile, parameterValues } from "../expressions.js";
import { number } from "../numbers.js";
import { nearestTo } from "../plots.js";
import { between, film, mixed } from "./film.js";
import { viewOf } from "./kinds.js";
import { range } from "../fields.js";
import { dot, fitted, line, surface } from "./surface.js";

const FRAMES = 601;
const FLASH = 0.02; // fraction of the time horizon for which an impact is visible
const CLOSED = 1e-4; // fraction of the largest gap below which a contact counts as closed

const contactsOf = (specification) => {
  const contacts = specification.problem.mechanical?.contacts;
  return Array.isArray(contacts) ? contacts.filter(({ name }) => typeof name === "string" && !name.includes("..")) : [];
};

export function needs(specification) {
  if (!viewOf(specification) && contactsOf(specification).length === 0) return null;
  return { ...film(specification), output: { times: { count: FRAMES } } };
}

// Returns a function that gives the value of a name in an expression at a time: a field, a parameter, or a definition
// in these.
function scopeOf(specification, run) {
  const [problem] = Object.values(specification.problem);
  const parameters = parameterValues(problem.parameters);
  const definitions = Object.fromEntries(Object.entries(problem.definitions ?? {}).map(([name, text]) => [name, compile(text)]));
  return (now, time) => {
    const scope = (name) => {
      if (name === "t") return time;
      const column = run.fields[name];
      if (column) return mixed(column, now.k, Math.min(now.k + 1, run.t.length - 1), now.part);
      return parameters[name] ?? definitions[name]?.(scope);
    };
    return scope;
  };
}

export function make(specification, run, { canvas } = {}) {
  const view = viewOf(specification);
  return view ? drawn(specification, run, view, canvas) : gauges(specification, run, canvas);
}

const at = (expression, scope) => {
  try {
    return expression(scope);
  } catch {
    return NaN;
  }
};

function drawn(specification, run, view, standing) {
  const scoped = scopeOf(specification, run);
  const points = Object.entries(view.points).map(([name, list]) => ({ name, parts: list.map(compile) })).filter(({ parts }) => parts.length >= 2 && parts.every((part) => part !== null));
  const placesAt = (now, time) => {
    const scope = scoped(now, time);
    return new Map(points.map(({ name, parts }) => [name, parts.map((part) => at(part, scope))]));
  };
  const seen = run.t.flatMap((time, k) => (k % 5 === 0 ? [...placesAt({ k, part: 0 }, time).values()] : [])).filter((place) => place.every(Number.isFinite));
  if (seen.length === 0) return null;
  const xs = range(seen.flatMap(([x, , r = 0]) => [x - r, x + r]));
  const ys = range(seen.flatMap(([, y, r = 0]) => [y - r, y + r]));
  const contacts = contactsOf(specification);
  const frames = []; // the positions at the times of the run, computed when first needed
  const placesOf = (k) => (frames[k] ??= placesAt({ k, part: 0 }, run.t[k]));
  let time = run.t[0];
  const paint = (context, size) => {
    const { colour, height } = size;
    const now = between(run.t, time);
    const map = fitted([xs, ys], size, 36);
    const places = placesAt(now, time);
    const shown = ([x, y]) => [map.x(x), map.y(y)];
    const from = Math.max(0, now.k - 60);
    const behind = Array.from({ length: now.k + 1 - from }, (_, k) => placesOf(from + k));
    points.forEach(({ name }, i) => {
      const path = behind.map((places) => places.get(name)).filter((place) => place.every(Number.isFinite));
      if (path.length > 1) line(context, path.map(shown), colour(`--line-${i % 8}`) + "55", 1.4);
    });
    for (const segment of view.segments ?? []) {
      const ends = segment.map((name) => places.get(name)).filter((place) => place?.every(Number.isFinite));
      if (ends.length > 1) line(context, ends.map(shown), colour("--ink"), 2.4);
    }
    points.forEach(({ name }, i) => {
      const place = places.get(name);
      if (!place.every(Number.isFinite)) return;
      dot(context, ...shown(place), place[2] ? Math.max(2, place[2] * map.sx) : 5, colour(`--line-${i % 8}`));
    });
    lamps(context, size, contacts.map(({ name }) => ({ name, ...state(run, name, time, specification) })), height - 10);
  };
  const { canvas, redraw, dispose } = surface("The system in its plane at the time of the cursor", 360, paint, standing);
  return { element: canvas, dispose, draw: (to) => ((time = to), redraw()), hint: "Drawn by `view`; lines behind points are their paths." };
}

// Returns whether the contact `name` is closed at a time, and how recently an impact occurred: `flash` is 1 at an
// impact, 0 long after.
function state(run, name, time) {
  const gap = run.fields[`${name}_gap`];
  const horizon = run.t.at(-1) - run.t[0];
  const struck = run.events.filter((event) => event.of === name && event.kind === "impact" && event.t <= time).at(-1);
  const flash = struck ? Math.max(0, 1 - (time - struck.t) / (FLASH * horizon)) : 0;
  if (!gap) return { closed: false, flash, gap: NaN };
  const value = gap[nearestTo(run.t, time)];
  return { closed: Math.abs(value) <= CLOSED * Math.max(...range(gap).map(Math.abs), 1e-300), flash, gap: value };
}

function lamps(context, { colour }, contacts, y) {
  context.textAlign = "left";
  let x = 14;
  for (const { name, closed, flash } of contacts) {
    dot(context, x, y - 4, 5 + 4 * flash, flash > 0 ? colour("--hot") : closed ? colour("--lit") : colour("--rule"));
    context.fillStyle = colour("--ink");
    context.fillText(name, x + 12, y);
    x += 30 + context.measureText(name).width;
  }
}

function gauges(specification, run, standing) {
  const contacts = contactsOf(specification).filter(({ name }) => run.fields[`${name}_gap`]);
  if (contacts.length === 0) return null;
  const ranges = contacts.map(({ name }) => range(run.fields[`${name}_gap`]));
  let time = run.t[0];
  const paint = (context, { width, colour }) => {
    contacts.forEach(({ name }, i) => {
      const y = 26 + i * 34;
      const { closed, flash, gap } = state(run, name, time);
      const [left, right] = [130, width - 90];
      context.fillStyle = colour("--ink");
      context.textAlign = "left";
      context.fillText(name, 14, y + 4);
      line(context, [[left, y - 10], [left, y + 10]], colour("--ink"), 2);
      const length = ((right - left) * Math.max(0, gap)) / (ranges[i][1] || 1);
      line(context, [[left, y], [left + length, y]], colour("--accent"), 4);
      dot(context, left + length, y, 7 + 5 * flash, flash > 0 ? colour("--hot") : closed ? colour("--lit") : colour("--accent"));
      context.fillStyle = colour("--quiet");
      context.fillText(number(gap, 3), width - 80, y + 4);
    });
  };
  const { canvas, redraw, dispose } = surface("The gaps of the contacts at the time of the cursor", 20 + 34 * contacts.length, paint, standing);
  return {
    element: canvas,
    dispose,
    draw: (to) => ((time = to), redraw()),
    hint: "The gaps of the contacts; red: an impact, yellow: closed. Give a `view` with points and segments to see the system itself.",
  };
}
