// The picture of fields over space: the height of a membrane or a price over its obstacle, the deformation of
// strings, bars and blocks, with the contact zone coloured. A field on a rectangle is a map seen from above.

import { parameterValues, compile } from "../expressions.js";
import { number } from "../numbers.js";
import { range } from "../fields.js";
import { between, film, mixed } from "./film.js";
import { dot, fitted, line, surface } from "./surface.js";

const FRAMES = 121;
const ON_LINE = 161; // number of sample points over an interval
const ON_SIDE = 41; // number of sample points along each side of a rectangle
const TOUCHES = 1e-6; // fraction of the range of the field: a smaller distance to the obstacle is contact
const MOST_NODES = 4000;

const scopeOf = (problem) => {
  const values = parameterValues(problem.parameters);
  return (more) => (name) => more[name] ?? values[name];
};

const numberIn = (expression, scope) => {
  const compiled = compile(expression);
  try {
    return compiled ? compiled(scope({})) : NaN;
  } catch {
    return NaN;
  }
};

const spread = ([from, to], count) => Array.from({ length: count }, (_, k) => from + ((to - from) * k) / (count - 1));

// ---- pictures of obstacle problems

function placesOf(problem) {
  const scope = scopeOf(problem);
  const side = (ends) => ends.map((end) => numberIn(end, scope));
  const { x, y, z } = problem.domain ?? {};
  if (z || !x) return null;
  const xs = spread(side(x), y ? ON_SIDE : ON_LINE);
  if (!y) return { xs, ys: null, points: xs.map((at) => [at]) };
  const ys = spread(side(y), ON_SIDE);
  return { xs, ys, points: ys.flatMap((b) => xs.map((a) => [a, b])) };
}

export function obstacleNeeds(specification) {
  const problem = specification.problem.obstacle;
  const places = placesOf(problem);
  if (!places || !places.points.flat().every(Number.isFinite)) return null;
  const probes = Object.fromEntries(places.points.map((at, k) => [`picture_${k}`, at]));
  return {
    ...film(specification),
    problem: { obstacle: { ...problem, probes, definitions: undefined, integrals: undefined } },
    stop: undefined,
    output: { times: { count: FRAMES }, fields: Object.keys(probes) },
  };
}

export function obstacleMake(specification, run, { canvas: standing } = {}) {
  const problem = specification.problem.obstacle;
  const { xs, ys, points } = placesOf(problem);
  const columns = points.map((_, k) => run.fields[`picture_${k}`]);
  const scope = scopeOf(problem);
  const bounds = ["obstacle", "upper_obstacle"].map((key) => (problem[key] === undefined ? null : compile(problem[key])));
  const boundAt = (bound, [x, y], t) => {
    try {
      return bound(scope({ x, y, t }));
    } catch {
      return NaN;
    }
  };
  const [low, high] = range(columns.flatMap((column) => range(column)));
  const near = TOUCHES * (high - low || 1);
  let time = run.t[0];
  const at = (place, { k, part }) => mixed(columns[place], k, Math.min(k + 1, run.t.length - 1), part);
  const touches = (u, place) => bounds.some((bound) => bound !== null && Math.abs(u - boundAt(bound, points[place], time)) <= near);

  const onLine = (context, size) => {
    const { colour } = size;
    const now = between(run.t, time);
    const map = fitted([[xs[0], xs.at(-1)], [low - 0.05 * (high - low), high + 0.05 * (high - low)]], size, 30, true);
    for (const bound of bounds) {
      if (bound === null) continue;
      const drawn = points.map((point) => [map.x(point[0]), map.y(boundAt(bound, point, time))]).filter(([, y]) => Number.isFinite(y));
      line(context, drawn, colour("--quiet"), 1.4, [5, 3]);
    }
    const values = points.map((_, place) => at(place, now));
    line(context, values.map((u, place) => [map.x(xs[place]), map.y(u)]), colour("--accent"), 2.2);
    values.forEach((u, place) => touches(u, place) && dot(context, map.x(xs[place]), map.y(u), 3, colour("--hot")));
    scale(context, size, [xs[0], xs.at(-1)], [low, high]);
  };
  const onPlane = (context, size) => {
    const { colour, width, height } = size;
    const now = between(run.t, time);
    const map = fitted([[xs[0], xs.at(-1)], [ys[0], ys.at(-1)]], { ...size, width: width - 90 }, 16);
    const [w, h] = [(xs[1] - xs[0]) * map.sx + 1, (ys[1] - ys[0]) * map.sy + 1];
    points.forEach(([x, y], place) => {
      const u = at(place, now);
      context.fillStyle = heat((u - low) / (high - low || 1));
      context.fillRect(map.x(x) - w / 2, map.y(y) - h / 2, w, h);
      if (touches(u, place)) dot(context, map.x(x), map.y(y), Math.min(w, h) / 4, "#ffffff");
    });
    for (let k = 0; k < 100; k += 1) {
      context.fillStyle = heat(1 - k / 99);
      context.fillRect(width - 74, 20 + (k * (height - 40)) / 100, 16, (height - 40) / 100 + 1);
    }
    context.fillStyle = colour("--ink");
    context.textAlign = "left";
    context.fillText(number(high, 3), width - 52, 28);
    context.fillText(number(low, 3), width - 52, height - 16);
  };
  const { canvas, redraw, dispose } = surface("The solution over space at the time of the cursor", ys ? 380 : 280, ys ? onPlane : onLine, standing);
  return {
    element: canvas,
    dispose,
    draw: (to) => ((time = to), redraw()),
    hint: ys ? "Colour: u; white dots: contact with an obstacle." : "Blue: u; dashed: the obstacle; red: contact.",
  };
}

// ---- pictures of elastic bodies

function gridOf(problem) {
  const scope = scopeOf(problem);
  const [kind, body] = Object.entries(problem.body ?? {})[0] ?? [];
  if (!kind || kind === "box") return null;
  const ends = (side) => side.map((end) => numberIn(end, scope));
  const count = (axis) => (typeof problem.elements === "number" ? problem.elements : (problem.elements?.[axis] ?? 1));
  const xs = spread(ends(body.x), count("x") + 1);
  const ys = body.y ? spread(ends(body.y), count("y") + 1) : null;
  const nodes = ys ? ys.flatMap((y, j) => xs.map((x, i) => ({ x, y, key: `${i},${j}` }))) : xs.map((x, i) => ({ x, y: 0, key: `${i}` }));
  return nodes.length > MOST_NODES ? null : { kind, xs, ys, nodes };
}

// Whether a node of an elastic body is clamped, so that it has no unknowns: it lies on a clamped side.
const isClamped = ({ xs, ys }, { x, y }, clamped) =>
  clamped.some((side) => ({ x_min: x === xs[0], x_max: x === xs.at(-1), y_min: ys && y === ys[0], y_max: ys && y === ys.at(-1) })[side]);

export function elasticNeeds(specification) {
  const problem = specification.problem.elastic;
  const grid = gridOf(problem);
  if (!grid) return null;
  const free = grid.nodes.filter((node) => !isClamped(grid, node, problem.clamped ?? []));
  const fields = free.flatMap(({ key }) => (grid.ys ? [`ux(${key})`, `uy(${key})`] : [`u(${key})`]));
  return { ...film(specification), output: { times: { count: FRAMES }, fields } };
}

export function elasticMake(specification, run, { canvas: standing } = {}) {
  const problem = specification.problem.elastic;
  const grid = gridOf(problem);
  const scope = scopeOf(problem);
  let time = run.t[0];
  const displacement = (name, now) => {
    const column = run.fields[name];
    return column ? mixed(column, now.k, Math.min(now.k + 1, run.t.length - 1), now.part) : 0;
  };
  const gap = (side) => {
    const given = problem.contact?.[side]?.gap;
    return given === undefined ? null : numberIn(given, scope);
  };
  const nodesAt = (now) =>
    grid.nodes.map(({ x, y, key }) => {
      if (grid.ys) return [x + displacement(`ux(${key})`, now), y + displacement(`uy(${key})`, now)];
      return grid.kind === "string" ? [x, displacement(`u(${key})`, now)] : [x + displacement(`u(${key})`, now), 0];
    });
  const all = run.t.flatMap((_, k) => (k % 6 === 0 ? nodesAt({ k, part: 0 }) : []));
  let [xs, ys] = [range(all.map(([x]) => x)), range(all.map(([, y]) => y))];
  const walls = { x_min: gap("x_min"), x_max: gap("x_max"), y_min: gap("y_min"), y_max: gap("y_max") };
  const wall = {
    x_min: walls.x_min === null ? null : grid.xs[0] - walls.x_min,
    x_max: walls.x_max === null ? null : grid.xs.at(-1) + walls.x_max,
    y_min: walls.y_min === null || !grid.ys ? null : grid.ys[0] - walls.y_min,
    y_max: walls.y_max === null || !grid.ys ? null : grid.ys.at(-1) + walls.y_max,
  };
  for (const side of ["x_min", "x_max"]) if (Number.isFinite(wall[side]) && wall[side] !== null) xs = range([...xs, wall[side]]);
  for (const side of ["y_min", "y_max"]) if (Number.isFinite(wall[side]) && wall[side] !== null) ys = range([...ys, wall[side]]);
  if (grid.kind === "bar") ys = [-(xs[1] - xs[0]) / 12, (xs[1] - xs[0]) / 12];
  const floors = grid.kind === "string" ? ["below", "above"].map((side) => [side, gap(side)]).filter(([, at]) => Number.isFinite(at) && at !== null) : [];
  for (const [side, at] of floors) ys = range([...ys, side === "below" ? -at : at]);

  const paint = (context, size) => {
    const { colour } = size;
    const now = between(run.t, time);
    const map = fitted([xs, ys], size, 28, grid.kind === "string");
    const nodes = nodesAt(now).map(([x, y]) => [map.x(x), map.y(y)]);
    for (const [side, at] of Object.entries(wall)) {
      if (at === null || !Number.isFinite(at)) continue;
      const across = side[0] === "x";
      const [a, b] = across ? [[map.x(at), map.y(ys[0])], [map.x(at), map.y(ys[1])]] : [[map.x(xs[0]), map.y(at)], [map.x(xs[1]), map.y(at)]];
      line(context, [a, b], colour("--quiet"), 3);
    }
    for (const [side, at] of floors) line(context, [[map.x(xs[0]), map.y(side === "below" ? -at : at)], [map.x(xs[1]), map.y(side === "below" ? -at : at)]], colour("--quiet"), 3);
    if (!grid.ys) {
      if (grid.kind === "string") line(context, nodes, colour("--accent"), 2.4);
      else for (const [x, y] of nodes) line(context, [[x, y - 24], [x, y + 24]], colour("--accent"), 1.2);
      return;
    }
    const columns = grid.xs.length;
    for (let j = 0; j < grid.ys.length; j += 1) line(context, nodes.slice(j * columns, (j + 1) * columns), colour("--accent"), 1);
    for (let i = 0; i < columns; i += 1) line(context, grid.ys.map((_, j) => nodes[j * columns + i]), colour("--accent"), 1);
    // A node of an elastic body within a thousandth of the height of the wall is drawn as touching the wall.
    const near = 1e-3 * (ys[1] - ys[0]);
    grid.nodes.forEach((node, place) => {
      const [x, y] = nodesAt(now)[place];
      const on = { y_min: node.y === grid.ys[0] && y - wall.y_min < near, y_max: node.y === grid.ys.at(-1) && wall.y_max - y < near, x_min: node.x === grid.xs[0] && x - wall.x_min < near, x_max: node.x === grid.xs.at(-1) && wall.x_max - x < near };
      if (Object.entries(on).some(([side, touching]) => wall[side] !== null && touching)) dot(context, ...nodes[place], 3.5, colour("--hot"));
    });
  };
  const { canvas, redraw, dispose } = surface("The body, deformed, at the time of the cursor", grid.kind === "bar" ? 180 : 300, paint, standing);
  return {
    element: canvas,
    dispose,
    draw: (to) => ((time = to), redraw()),
    hint: grid.ys ? "Displacements to scale; red: nodes in contact with the obstacle." : grid.kind === "string" ? "The string; grey: the obstacle." : "Displaced sections of the bar; grey: the obstacle.",
  };
}

// Writes the end values of both axes beside the picture.
function scale(context, { width, height, colour }, xs, ys) {
  context.fillStyle = colour("--quiet");
  context.textAlign = "left";
  context.fillText(number(xs[0], 3), 28, height - 8);
  context.fillText(number(ys[1], 3), 4, 26);
  context.fillText(number(ys[0], 3), 4, height - 26);
  context.textAlign = "right";
  context.fillText(number(xs[1], 3), width - 28, height - 8);
}

// Returns the colour of a value between 0 and 1, from dark blue over green to yellow, with evenly growing lightness.
function heat(part) {
  const stops = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const at = Math.min(1, Math.max(0, part)) * (stops.length - 1);
  const [low, rest] = [Math.min(Math.floor(at), stops.length - 2), at - Math.min(Math.floor(at), stops.length - 2)];
  return `rgb(${stops[low].map((one, i) => Math.round(one + rest * (stops[low + 1][i] - one))).join()})`;
}
