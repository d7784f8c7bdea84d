// Figures for papers: panels and phase planes as SVG, black on white whatever the colours of the page, with names and
// units on the axes, a legend if there are several lines, and events as ticks below. A PNG is the figure as pixels.

import { hasSeconds, isConstant, range, typeOf } from "./fields.js";
import { number, ticks } from "./numbers.js";

const NAMESPACE = "http://www.w3.org/2000/svg";
const LEFT = 74;
const RIGHT = 34;
const COLOURS = ["#1f5a93", "#c2571a", "#2b7d46", "#8a3f8f", "#8a6d00", "#00798c", "#a4262c", "#555555"];
const MOST_POINTS = 4000; // largest number of points of a line: a pixel of a figure shows no more

export const colourOf = (place) => COLOURS[place % COLOURS.length];

export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS(NAMESPACE, name);
  for (const [key, value] of Object.entries(attributes)) if (value != null) made.setAttribute(key, value);
  made.append(...children.filter((child) => child != null));
  return made;
}

// Returns about `count` round values between `low` and `high`, both included if they are round.
export function roundValues(low, high, count) {
  if (!(high > low)) return [low];
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].find((factor) => factor * power >= raw) * power;
  const values = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) values.push(k * step);
  return values;
}

function powersOfTen(low, high) {
  const values = [];
  for (let power = Math.ceil(Math.log10(low) - 1e-9); 10 ** power <= high * (1 + 1e-9); power += 1) values.push(10 ** power);
  const every = Math.ceil(values.length / 7);
  return values.length < 2 ? [low, high] : values.filter((_, i) => i % every === 0);
}

// Returns an axis of a figure: the map from values to pixels, and the ticks with their labels.
export function axis([low, high], [from, to], log = false) {
  const [a, b] = log ? [Math.log10(low), Math.log10(high)] : [low, high];
  const at = (value) => from + (((log ? Math.log10(value) : value) - a) / (b - a || 1)) * (to - from);
  const values = log ? powersOfTen(low, high) : roundValues(low, high, Math.max(2, Math.round(Math.abs(to - from) / 70)));
  return { at, values, labels: log ? values.map((value) => number(value, 3)) : ticks(values) };
}

// Returns a range of values with room on both sides, for an axis; for a constant, with room as large as the constant.
export function padded([low, high], log = false) {
  if (log) return [low / 1.3, high * 1.3];
  const room = isConstant([low, high]) ? Math.abs(low) / 2 || 1 : 0.06 * (high - low);
  return [low - room, high + room];
}

const text = (attributes, words) => svg("text", { "font-size": 12, fill: "#222", ...attributes }, words);

const path = (points, attributes) =>
  svg("path", { d: points.length === 0 ? "" : `M${points.map(([x, y]) => `${x.toFixed(2)} ${y.toFixed(2)}`).join("L")}`, fill: "none", "stroke-width": 1.4, ...attributes });

function frame(x, y, [left, right, top, bottom], { xName, yName, withX = true }) {
  const parts = [svg("rect", { x: left, y: top, width: right - left, height: bottom - top, fill: "none", stroke: "#888" })];
  x.values.forEach((value, i) => {
    parts.push(svg("line", { x1: x.at(value), x2: x.at(value), y1: top, y2: bottom, stroke: "#e4e4e4" }));
    if (withX) parts.push(text({ x: x.at(value), y: bottom + 15, "text-anchor": "middle" }, x.labels[i]));
  });
  y.values.forEach((value, i) => {
    parts.push(svg("line", { x1: left, x2: right, y1: y.at(value), y2: y.at(value), stroke: "#e4e4e4" }));
    parts.push(text({ x: left - 6, y: y.at(value) + 4, "text-anchor": "end" }, y.labels[i]));
  });
  if (withX && xName) parts.push(text({ x: (left + right) / 2, y: bottom + 32, "text-anchor": "middle", "font-style": "italic" }, xName));
  const middle = (top + bottom) / 2;
  parts.push(text({ x: 14, y: middle, "text-anchor": "middle", "font-style": "italic", transform: `rotate(-90 14 ${middle})` }, yName));
  return parts;
}

const root = (width, height, title, ...parts) =>
  svg(
    "svg",
    { xmlns: NAMESPACE, width, height, viewBox: `0 0 ${width} ${height}`, "font-family": "Helvetica, Arial, sans-serif", role: "img" },
    svg("title", {}, title),
    svg("rect", { width, height, fill: "#ffffff" }),
    ...parts,
  );

const sparse = (count) => Math.max(1, Math.ceil(count / MOST_POINTS));

// Draws the panels of `Plots.figure()` below each other.
export function panelsFigure(panels, { title = "", specification = {}, span = null, logTime = false, width = 760 } = {}) {
  const all = panels.flatMap((panel) => panel.series);
  const starts = all.map(({ t }) => (logTime ? t.find((time) => time > 0) : t[0]));
  const times = span ?? [Math.min(...starts), Math.max(...all.map(({ t }) => t.at(-1)))];
  const [height, between] = [panels.length > 2 ? 130 : 200, 26];
  const total = 34 + panels.length * (height + between) + 24;
  const x = axis(times, [LEFT, width - RIGHT], logTime);
  const parts = [text({ x: LEFT, y: 13, "font-weight": "bold" }, title)];
  panels.forEach((panel, i) => {
    const top = 34 + i * (height + between);
    const bottom = top + height;
    const lines = panel.series.map((line) => ({ ...line, values: [...line.values] }));
    const within = lines.map(({ t, values }) => range(values.filter((_, k) => t[k] >= times[0] && t[k] <= times[1])));
    const [low, high] = padded([Math.min(...within.map((one) => one[0])), Math.max(...within.map((one) => one[1]))], panel.log);
    const y = axis([low, high], [bottom, top], panel.log);
    const alone = panel.fields.length === 1;
    const unit = panel.unit ? ` in ${panel.unit}` : "";
    const last = i === panels.length - 1;
    const xName = hasSeconds(typeOf(specification)) ? "t in s" : "t";
    parts.push(...frame(x, y, [LEFT, width - RIGHT, top, bottom], { xName, yName: (alone ? panel.fields[0] : panel.quantity) + unit, withX: last }));
    lines.forEach(({ t, values, dash, name }) => {
      const every = sparse(t.length);
      const place = panel.fields.indexOf(name);
      const points = [];
      for (let k = 0; k < t.length; k += 1) {
        if (t[k] < times[0] || t[k] > times[1] || (k % every !== 0 && k !== t.length - 1)) continue;
        points.push([x.at(t[k]), y.at(values[k])]);
      }
      parts.push(path(points, { stroke: colourOf(place), "stroke-dasharray": dash?.join(" ") }));
    });
    const drawn = new Set();
    for (const { t } of panel.events) {
      const at = Math.round(x.at(t));
      if (t < times[0] || t > times[1] || drawn.has(at)) continue;
      drawn.add(at);
      parts.push(svg("line", { x1: at, x2: at, y1: bottom, y2: bottom - 6, stroke: "#333" }));
    }
    if (!alone) parts.push(...legend(panel.fields, width - RIGHT, top - 6));
  });
  return root(width, total, title || "Trajectories", ...parts);
}

// Draws the legend of a figure, the names of its lines with their colours, from the right.
function legend(names, right, y) {
  const parts = [];
  let x = right;
  names
    .map((name, place) => ({ name, place }))
    .reverse()
    .forEach(({ name, place }) => {
      parts.push(text({ x, y, "text-anchor": "end" }, name));
      x -= 7 * name.length + 6;
      parts.push(svg("line", { x1: x - 16, x2: x, y1: y - 4, y2: y - 4, stroke: colourOf(place), "stroke-width": 2 }));
      x -= 28;
    });
  return parts;
}

// Draws a phase plane: one field of a run over another.
export function phaseFigure(run, horizontal, vertical, { title = "", specification = {}, describe, width = 560, height = 440, equal = false } = {}) {
  const named = (field) => {
    const { unit } = describe(field, specification);
    return unit ? `${field} in ${unit}` : field;
  };
  const columns = [run.fields[horizontal] ?? run.t, run.fields[vertical] ?? run.t];
  let [xs, ys] = columns.map((column) => padded(range(column)));
  const box = [LEFT, width - RIGHT, 30, height - 44];
  if (equal) [xs, ys] = sameScale(xs, ys, (box[1] - box[0]) / (box[3] - box[2]));
  const x = axis(xs, [box[0], box[1]]);
  const y = axis(ys, [box[3], box[2]]);
  const every = sparse(run.t.length);
  const points = [];
  for (let k = 0; k < run.t.length; k += 1) {
    if (k % every === 0 || k === run.t.length - 1) points.push([x.at(columns[0][k]), y.at(columns[1][k])]);
  }
  const marker = svg("circle", { class: "now", r: 5, fill: "#a4262c", cx: points[0]?.[0], cy: points[0]?.[1] });
  const made = root(
    width,
    height,
    `${vertical} over ${horizontal}`,
    text({ x: LEFT, y: 18, "font-weight": "bold" }, title),
    ...frame(x, y, box, { xName: named(horizontal), yName: named(vertical) }),
    path(points, { stroke: colourOf(0) }),
    marker,
  );
  const move = (k) => {
    marker.setAttribute("cx", x.at(columns[0][k]));
    marker.setAttribute("cy", y.at(columns[1][k]));
  };
  return { figure: made, move };
}

// Enlarges the ranges of two axes until a unit is equally long along both.
export function sameScale(xs, ys, aspect) {
  const [wide, high] = [xs[1] - xs[0], ys[1] - ys[0]];
  const grown = ([low, end], to) => [(low + end - to) / 2, (low + end + to) / 2];
  return wide / high > aspect ? [xs, grown(ys, wide / aspect)] : [grown(xs, high * aspect), ys];
}

export const textOf = (figure) => new XMLSerializer().serializeToString(figure);

// Returns an SVG figure as a PNG image of twice its size.
export async function png(figure) {
  const image = new Image();
  const address = URL.createObjectURL(new Blob([textOf(figure)], { type: "image/svg+xml" }));
  try {
    image.src = address;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [2 * image.width, 2 * image.height];
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  } finally {
    URL.revokeObjectURL(address);
  }
}
