// Plots of trajectories: one panel for each quantity, all over the same times, with one cursor and one zoom, and one
// line for each field of each run.
//
// While a slider is dragged, only panels in view are drawn, with their lines as hairlines; the other panels are drawn
// when they come into view, or when the slider rests.
//
// Dragging zooms, a double click shows the whole time range; so do the arrow keys, `+`, `-` and `0` when the panels
// have the focus. Events are ticks at the bottom of a panel, at most one per pixel; an earlier run is drawn as a
// ghost behind the lines.

import { largestDifference } from "./comparison.js";
import { colourOf } from "./colours.js";
import { element } from "./element.js";
import { hairlines } from "./hairlines.js";
import { hasDecades, hasSeconds, isConstant, isRounding, panels, range, typeOf, wantsDecades } from "./fields.js";
import { number, ticks } from "./numbers.js";

const HEIGHTS = [300, 220, 180, 156]; // pixels of the height of a panel, if there are one, two, three or more panels
const FOOT = 36; // pixels of the time labels below a panel
const NEAR = 6; // pixels within which the pointer is on an event
const FINE_DECADES = 4; // largest number of decades for which a logarithmic grid has lines within a decade
const OFFERED = 30; // ratio of the largest to the least value from which a logarithmic axis is offered
const TICK = 7; // pixels of the length of an event's tick
const WIDTH = 1.6; // pixels of the width of a line
const EDGE = 4; // pixels of a panel that may be in view although the panel has not been drawn

export class Plots {
  #root;
  #hover;
  #runs = [];
  #ghost = null;
  #fields = [];
  #specification = {};
  #logTime = false;
  #linear = new Set(); // quantities for which the reader has switched between a linear and a logarithmic axis
  #panels = [];
  #span = null; // the range of times that is shown
  #syncing = false;
  #time = null;
  #pointed = null; // the time at the pointer, {time, near}, at which values are shown
  #sight = new IntersectionObserver((changes) => this.#sighted(changes), { rootMargin: `-${EDGE}px` }); // observes which panels are in view
  #hurried = false; // whether a slider is dragged

  // Called with a time when the reader clicks on that time in a plot.
  picked = () => {};

  constructor(root, hover) {
    this.#root = root;
    this.#hover = hover;
    root.tabIndex = 0;
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", "Plots: arrows move the cursor, plus and minus zoom, 0 shows all");
    root.addEventListener("keydown", (event) => this.#key(event));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#build());
    let width = 0;
    new ResizeObserver(() => {
      if (root.clientWidth === width) return;
      width = root.clientWidth;
      for (const { plot, height } of this.#panels) plot.setSize({ width, height });
      this.#placeHeads();
    }).observe(root);
  }

  // Shows fields of runs, `{t, fields, events}` each, of the problem of `specification`; `ghost` is the run that the
  // reader saw before. If `hurried`, panels out of view are drawn later.
  show(runs, fields, { specification = {}, logTime = false, ghost = null, hurried = false } = {}) {
    const sameFields = fields.length === this.#fields.length && fields.every((field, i) => field === this.#fields[i]);
    const [type, before] = [typeOf(specification), typeOf(this.#specification)];
    const steady = sameFields && type === before && logTime === this.#logTime && runs.length === 1 && this.#runs.length === 1;
    const sameTimes = steady && runs[0].t[0] === this.#runs[0].t[0] && runs[0].t.at(-1) === this.#runs[0].t.at(-1);
    [this.#runs, this.#fields, this.#specification, this.#logTime, this.#ghost, this.#hurried] = [runs, fields, specification, logTime, ghost, hurried];
    if (!sameTimes) this.#span = null;
    if (steady && this.#panels.length > 0 && this.#renew()) return;
    this.#build();
  }

  // Returns the data of the panels of the plot, from which a figure for papers is drawn.
  figure() {
    return this.#panels.map((panel) => ({
      ...panel.group,
      log: panel.log,
      series: panel.series.map(({ run, field, colour, dash }) => ({ name: field, t: run.t, values: run.fields[field], colour, dash, run: run.label })),
      events: this.#runs[0].events.filter((event) => panel.group.fields.some((field) => isOf(event, field))),
    }));
  }

  get span() {
    return this.#span;
  }

  // Draws the time cursor of the pictures in all panels of the plot.
  setTime(time) {
    this.#time = time;
    this.#placeHeads();
  }

  // Draws new values in the same panels of the plot, as a slider demands many times a second. Returns false if the
  // panels have to be built anew.
  #renew() {
    if (!(this.#hurried ? this.#canShow() : this.#suits())) return false;
    for (const panel of this.#panels) {
      panel.series = this.#series(panel.group);
      if (this.#hurried && !panel.seen) panel.waits = true;
      else this.#redraw(panel);
    }
    if (this.#pointed !== null) this.#tell({ time: this.#pointed.time, near: null });
    this.#placeHeads();
    return true;
  }

  // Whether the panels can show the fields of the run, though other panels might suit them better.
  #canShow() {
    const { fields } = this.#runs[0];
    return this.#panels.every(({ group, log }) => group.fields.every((field) => fields[field] && !(log && range(fields[field])[0] <= 0)));
  }

  // Whether the panels are those that would be built for the fields of the run.
  #suits() {
    const { fields } = this.#runs[0];
    const groups = this.#groups();
    if (groups.length !== this.#panels.length || groups.some((group, i) => group.fields.join() !== this.#panels[i].group.fields.join())) return false;
    return this.#panels.every(({ group, log }) =>
      group.fields.every((field) => fields[field]) && this.#isLog(group, group.fields.map((field) => range(fields[field]))) === log);
  }

  #redraw(panel) {
    panel.waits = false;
    this.#tellConstants(panel);
    for (const line of panel.plot.series) line.width = this.#hurried ? 1 / devicePixelRatio : WIDTH;
    panel.plot.setData(this.#data(panel.series), false);
    panel.plot.batch(() => {
      const [min, max] = this.#span ?? this.#whole();
      panel.plot.setScale("x", { min, max });
    });
  }

  // Draws panels of the plot that came into view, and notes those that left it.
  #sighted(changes) {
    for (const { target, isIntersecting } of changes) {
      const panel = this.#panels.find(({ canvas }) => canvas === target);
      if (!panel) continue;
      panel.seen = isIntersecting;
      if (panel.seen && panel.waits) this.#redraw(panel);
    }
  }

  #build() {
    this.#hurried = false;
    this.#sight.disconnect();
    for (const { plot } of this.#panels) plot.destroy();
    this.#root.replaceChildren();
    this.#panels = [];
    if (this.#runs.length === 0) return;
    const groups = this.#groups();
    const height = HEIGHTS[Math.min(groups.length, HEIGHTS.length) - 1];
    this.#panels = groups.map((group, i) => this.#panel(group, height, i === groups.length - 1));
    this.#tell(null);
    if (this.#span) this.#zoom(...this.#span);
    this.#placeHeads();
  }

  #groups() {
    const [run] = this.#runs;
    const size = (field) => (run.fields[field] ? Math.max(...range(run.fields[field]).map(Math.abs)) : 0);
    return panels(this.#fields, this.#specification, size);
  }

  #isLog(group, ranges) {
    return ranges.every(hasDecades) && ranges.some(wantsDecades) !== this.#linear.has(group.quantity);
  }

  #series(group) {
    const shown = this.#runs.flatMap((run, place) =>
      group.fields
        .filter((field) => run.fields[field])
        .map((field) => {
          const at = group.fields.indexOf(field);
          const second = group.fields.length === 1 && place === 1;
          return { run, field, place, colour: colourOf(second ? "--second" : `--line-${at}`), dash: place ? [6, 4] : undefined };
        }),
    );
    return shown;
  }

  // Returns the columns of a panel of the plot. The ghost (an earlier run) comes first, behind all lines; without a
  // ghost its columns are empty, so that a panel can get a ghost without being built anew.
  #data(series) {
    const ghosts = series.map(({ run, field }) => (this.#ghost === null ? { run, field: null } : { run: this.#ghost, field }));
    const all = [...ghosts, ...series];
    const same = all.every(({ run }) => run.t === all[0].run.t);
    const from = this.#logTime ? (t) => t.findIndex((time) => time > 0) : () => 0;
    const column = ({ run, field }) => (run.fields[field] ?? run.t.map(() => null)).slice(from(run.t));
    if (same) return [all[0].run.t.slice(from(all[0].run.t)), ...all.map(column)];
    return uPlot.join(all.map((one) => [one.run.t.slice(from(one.run.t)), column(one)]));
  }

  #panel(group, height, last) {
    const series = this.#series(group);
    const ranges = group.fields.map((field) => range(this.#runs.flatMap((run) => run.fields[field] ?? [])));
    const log = this.#isLog(group, ranges);
    const values = element("span", { class: "values" });
    const alone = group.fields.length === 1;
    const first = group.fields[0];
    const [a, b] = this.#runs;
    const differs = alone && b?.fields[first] ? largestDifference(a.t, a.fields[first], b.t, b.fields[first]) : null;
    const difference = differs === null ? null : element("span", { class: "difference" }, `largest difference ${number(differs, 3)}`);
    const unit = group.unit ? ` in ${group.unit}` : "";
    const title = element("b", {}, alone ? first : group.quantity, unit === "" ? null : element("span", { class: "unit" }, unit));
    const scale = ranges.every(hasDecades) && (log || ranges.some(([least, largest]) => largest / least >= OFFERED))
      ? element("button", { type: "button", class: "scale", "aria-pressed": String(log), click: () => this.#toggle(group) }, "log")
      : null;
    const canvas = element("div");
    const figure = element("figure", { "data-field": group.fields.join(" ") }, element("figcaption", {}, title, values, difference, scale), canvas);
    this.#root.append(figure);

    const font = `11px ${getComputedStyle(this.#root).fontFamily}`;
    const axis = { stroke: colourOf("--quiet"), font, labelFont: font, grid: { stroke: colourOf("--grid"), width: 1 }, ticks: { show: false } };
    const line = ({ colour, dash, run, field }) => ({ label: field, stroke: colour, width: WIDTH, dash, paths, points: { show: run.t.length < 3 } });
    const ghosts = series.map(({ colour }) => ({ stroke: `${colour}55`, width: WIDTH, points: { show: false } }));
    const straight = uPlot.paths.linear();
    const paths = (...of) => {
      const made = straight(...of);
      return this.#hurried ? { ...made, stroke: hairlines(made.stroke, WIDTH * devicePixelRatio) } : made;
    };
    const total = height + (last ? FOOT : 0);
    const options = {
      width: this.#root.clientWidth || 600,
      height: total,
      padding: [8, null, 0, 0],
      legend: { show: false },
      scales: { x: { time: false, distr: this.#logTime ? 3 : 1 }, y: { distr: log ? 3 : 1, range: log ? undefined : (_, low, high) => roomy(low, high) } },
      cursor: { sync: { key: "t" }, drag: { x: true, y: false }, y: false },
      series: [{}, ...ghosts, ...series.map(line)],
      axes: [
        {
          ...axis,
          size: last ? 26 : 6,
          values: (_, at) => (last ? labels(at, this.#logTime) : at.map(() => "")),
          grid: decades(axis.grid, this.#logTime),
          label: last ? (hasSeconds(typeOf(this.#specification)) ? "t in s" : "t") : undefined,
          labelSize: 18,
          labelGap: -4,
        },
        { ...axis, size: 64, values: (_, at) => labels(at, log), grid: decades(axis.grid, log) },
      ],
      hooks: {
        draw: [(plot) => this.#drawEvents(plot, group, last)],
        setCursor: [(plot) => this.#point(plot)],
        setScale: [(plot, scale) => scale === "x" && this.#zoomed(plot)],
        ready: [(plot) => plot.over.addEventListener("click", () => this.#pick(plot))],
      },
    };
    const plot = new uPlot(options, this.#data(series), canvas);
    const head = element("div", { class: "head", hidden: true });
    plot.over.append(head);
    const panel = { group, series, values, height: total, log, plot, head, title, canvas, note: element("span", { class: "note" }), seen: true, waits: false };
    this.#sight.observe(canvas);
    title.after(panel.note);
    this.#tellConstants(panel);
    return panel;
  }

  // Notes below a panel that a curve is constant, or consists of rounding errors.
  #tellConstants({ group, note }) {
    const [run] = this.#runs;
    const scales = this.#fields.filter((field) => run.fields[field]).map((field) => Math.max(...range(run.fields[field]).map(Math.abs)));
    const told = group.fields
      .filter((field) => run.fields[field] && run.t.length > 2)
      .map((field) => {
        const alone = group.fields.length === 1 ? "" : `${field} `;
        const found = range(run.fields[field]);
        if (isConstant(found)) return `${alone}constant ${number(found[0])}`;
        if (group.unit !== "" && isRounding(found, Math.max(...scales))) return `${alone}zero to rounding`;
        return null;
      });
    const words = told.filter((one) => one !== null).slice(0, 3).join(", ");
    if (note.textContent !== words) note.textContent = words;
  }

  #toggle(group) {
    if (this.#linear.has(group.quantity)) this.#linear.delete(group.quantity);
    else this.#linear.add(group.quantity);
    this.#build();
    this.#root.querySelectorAll("figure .scale")[0]?.focus();
  }

  #drawEvents(plot, group, last) {
    const { ctx, bbox } = plot;
    const width = devicePixelRatio;
    const foot = bbox.top + bbox.height;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = width;
    this.#runs.forEach((run, place) => {
      const lift = place * (TICK + 2) * width;
      for (const own of last ? [false, true] : [true]) {
        const drawn = new Set();
        ctx.globalAlpha = own ? 0.9 : 0.45;
        for (const event of run.events) {
          const at = group.fields.findIndex((field) => isOf(event, field));
          if (at !== -1 !== own) continue;
          const x = Math.round(plot.valToPos(event.t, "x", true));
          // Where events accumulate, one tick per pixel shows as much as all of them.
          if (!(x >= bbox.left && x <= bbox.left + bbox.width) || drawn.has(x)) continue;
          drawn.add(x);
          ctx.strokeStyle = own ? colourOf(`--line-${at}`) : colourOf("--quiet");
          ctx.beginPath();
          ctx.moveTo(x, foot - lift);
          ctx.lineTo(x, foot - lift - TICK * width);
          ctx.stroke();
        }
      }
    });
    ctx.restore();
  }

  #pick(plot) {
    const { left } = plot.cursor;
    if (left >= 0) this.picked(plot.posToVal(left, "x"));
  }

  #placeHeads() {
    for (const { plot, head } of this.#panels) {
      const inside = this.#time !== null && this.#time >= plot.scales.x.min && this.#time <= plot.scales.x.max;
      head.hidden = !inside;
      if (inside) head.style.transform = `translateX(${plot.valToPos(this.#time, "x")}px)`;
    }
  }

  #point(plot) {
    const { left, idx } = plot.cursor;
    this.#tell(left == null || left < 0 || idx == null ? null : { time: plot.posToVal(left, "x"), near: this.#near(plot, left) });
  }

  #near(plot, left) {
    const distance = (event) => Math.abs(plot.valToPos(event.t, "x") - left);
    let nearest = null;
    for (const event of this.#runs.flatMap((run) => run.events)) {
      if (distance(event) <= NEAR && (!nearest || distance(event) < distance(nearest))) nearest = event;
    }
    return nearest;
  }

  #tell(at) {
    this.#pointed = at;
    for (const { group, series, values } of this.#panels) {
      const alone = group.fields.length === 1;
      const told = series.map(({ run, field, place, colour }) => {
        const value = at === null ? "" : number(run.fields[field][nearestTo(run.t, at.time)], 6);
        const shown = element("span", { class: place ? "second" : "first" }, alone ? value : `${field} ${value}`);
        if (!alone) shown.prepend(swatch(colour, place));
        return shown;
      });
      values.replaceChildren(...told);
    }
    const event = at?.near;
    this.#hover.textContent =
      at === null
        ? "Point at a plot to read it; drag to zoom, double-click to see all; click to move the time."
        : `t = ${number(at.time, 6)}${event ? ` · ${event.kind.replaceAll("_", " ")} of ${event.of} at t = ${number(event.t, 9)}` : ""}`;
  }

  #zoomed(plot) {
    if (this.#syncing) return;
    const { min, max } = plot.scales.x;
    this.#zoom(min, max);
  }

  #zoom(min, max) {
    this.#syncing = true;
    const [low, high] = this.#whole();
    this.#span = min <= low && max >= high ? null : [min, max];
    for (const { plot } of this.#panels) {
      if (plot.scales.x.min !== min || plot.scales.x.max !== max) plot.setScale("x", { min, max });
    }
    this.#placeHeads();
    // The uPlot library reports a new scale after the current task.
    queueMicrotask(() => queueMicrotask(() => (this.#syncing = false)));
  }

  #whole() {
    const start = (run) => (this.#logTime ? (run.t.find((time) => time > 0) ?? run.t[0]) : run.t[0]);
    return [Math.min(...this.#runs.map(start)), Math.max(...this.#runs.map((run) => run.t.at(-1)))];
  }

  #key(event) {
    const plot = this.#panels[0]?.plot;
    if (!plot || event.target !== this.#root || event.ctrlKey || event.metaKey || event.altKey) return;
    const { min, max } = plot.scales.x;
    const width = plot.over.clientWidth;
    const left = plot.cursor.left >= 0 ? plot.cursor.left : width / 2;
    const about = plot.posToVal(left, "x");
    const scaled = (factor) => {
      const [low, high] = this.#whole();
      this.#zoom(Math.max(low, about - (about - min) * factor), Math.min(high, about + (max - about) * factor));
    };
    const moved = (by) => {
      const to = Math.min(width, Math.max(0, left + by * (event.shiftKey ? 20 : 2)));
      for (const panel of this.#panels) panel.plot.setCursor({ left: to, top: 10 });
    };
    const keys = {
      ArrowLeft: () => moved(-1),
      ArrowRight: () => moved(1),
      "+": () => scaled(0.5),
      "=": () => scaled(0.5),
      "-": () => scaled(2),
      0: () => this.#zoom(...this.#whole()),
      Enter: () => this.#pick(plot),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }
}

const isOf = (event, field) => field === event.of || field.startsWith(`${event.of}_`) || field.endsWith(`(${event.of})`);

// Returns a range of an axis with some room above and below; for a constant, with room as large as the constant.
function roomy(low, high) {
  if (low == null || high == null) return [0, 1];
  const room = isConstant([low, high]) ? Math.abs(low) / 2 || 1 : (high - low) * 0.06;
  return [low - room, high + room];
}

const isDecade = (value) => value !== null && Math.abs(Math.log10(value) - Math.round(Math.log10(value))) < 1e-9;

// Restricts a logarithmic grid over many decades to powers of ten.
const decades = (grid, log) =>
  log ? { ...grid, filter: (_, at) => (at.filter(isDecade).length > FINE_DECADES ? at.map((value) => (isDecade(value) ? value : null)) : at) } : grid;

// Returns the tick labels of an axis; a logarithmic axis has labels at powers of ten only.
function labels(at, log) {
  if (!log) return ticks(at);
  return at.map((value) => (isDecade(value) ? number(value) : ""));
}

function swatch(colour, place) {
  const mark = element("i", { class: place ? "swatch dashed" : "swatch", "aria-hidden": "true" });
  mark.style.borderTopColor = colour;
  return mark;
}

// Returns the index of the element of `times` that is nearest to `time`.
export function nearestTo(times, time) {
  let [low, high] = [0, times.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return time - times[low] <= times[high] - time ? low : high;
}
