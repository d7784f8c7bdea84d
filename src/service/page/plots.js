// Trajectories: a panel a field, all over the same times, with one cursor and one zoom, and a line a run.
//
// Dragging zooms, a double click shows all; so do the arrows, `+`, `-` and `0` once the panels have the focus.

import { largestDifference } from "./comparison.js";
import { element } from "./element.js";
import { number, ticks } from "./numbers.js";

const HEIGHT = 132;
const LAST_HEIGHT = 158; // with the labels of the times
const NEAR = 6; // pixels within which an event is pointed at

export class Plots {
  #root;
  #hover;
  #runs = [];
  #fields = [];
  #panels = [];
  #span = null; // the times shown
  #syncing = false;

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
    }).observe(root);
  }

  // Shows these fields of these runs: `{t, fields, events}` each.
  show(runs, fields) {
    const same = runs.length === this.#runs.length && runs.every((run, i) => run === this.#runs[i]);
    this.#runs = runs;
    this.#fields = fields;
    if (!same) this.#span = null;
    this.#build();
  }

  #build() {
    for (const { plot } of this.#panels) plot.destroy();
    this.#root.replaceChildren();
    this.#panels = [];
    this.#panels = this.#fields.map((field, i) => this.#panel(field, i === this.#fields.length - 1));
    this.#tell(null);
    if (this.#span) this.#zoom(...this.#span);
  }

  #panel(field, last) {
    const style = getComputedStyle(this.#root);
    const colour = (name) => style.getPropertyValue(name).trim();
    const runs = this.#runs.filter((run) => run.fields[field]);
    const values = element("span", { class: "values" });
    const differs = runs.length > 1 ? largestDifference(runs[0].t, runs[0].fields[field], runs[1].t, runs[1].fields[field]) : null;
    const difference = differs === null ? null : element("span", { class: "difference" }, `largest difference ${number(differs, 3)}`);
    const canvas = element("div");
    const figure = element("figure", { "data-field": field }, element("figcaption", {}, element("b", {}, field), values, difference), canvas);
    this.#root.append(figure);

    const font = `11px ${style.fontFamily}`;
    const axis = { stroke: colour("--quiet"), font, grid: { stroke: colour("--grid"), width: 1 }, ticks: { show: false } };
    const stroke = [colour("--first"), colour("--second")];
    const series = runs.map((run) => {
      const place = this.#runs.indexOf(run);
      return { label: field, stroke: stroke[place], width: 1.6, dash: place ? [6, 4] : undefined, points: { show: run.t.length < 3 } };
    });
    const height = last ? LAST_HEIGHT : HEIGHT;
    const options = {
      width: this.#root.clientWidth || 600,
      height,
      legend: { show: false },
      scales: { x: { time: false } },
      cursor: { sync: { key: "t" }, drag: { x: true, y: false }, y: false },
      series: [{}, ...series],
      axes: [
        { ...axis, size: last ? 34 : 6, values: (_, at) => (last ? ticks(at) : at.map(() => "")) },
        { ...axis, size: 64, values: (_, at) => ticks(at) },
      ],
      hooks: {
        drawClear: [(plot) => this.#drawEvents(plot, field, stroke)],
        setCursor: [(plot) => this.#point(plot)],
        setScale: [(plot, scale) => scale === "x" && this.#zoomed(plot)],
      },
    };
    return { field, runs, values, height, plot: new uPlot(options, columns(runs, field), canvas) };
  }

  #drawEvents(plot, field, stroke) {
    const { ctx, bbox } = plot;
    const width = devicePixelRatio;
    ctx.save();
    ctx.lineWidth = width;
    this.#runs.forEach((run, i) => {
      ctx.strokeStyle = stroke[i];
      ctx.setLineDash(i ? [3 * width, 3 * width] : []);
      for (const own of [false, true]) {
        let drawn = -Infinity;
        ctx.globalAlpha = own ? 0.55 : 0.16;
        ctx.beginPath();
        for (const event of run.events) {
          if ((field === event.of || field.startsWith(`${event.of}_`)) !== own) continue;
          const x = Math.round(plot.valToPos(event.t, "x", true));
          // Where events accumulate, one line a pixel shows as much as all of them.
          if (x < bbox.left || x > bbox.left + bbox.width || x === drawn) continue;
          drawn = x;
          ctx.moveTo(x, bbox.top);
          ctx.lineTo(x, bbox.top + bbox.height);
        }
        ctx.stroke();
      }
    });
    ctx.restore();
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
    for (const { field, runs, values } of this.#panels) {
      const told = runs.map((run) => {
        const value = at === null ? null : run.fields[field][nearestTo(run.t, at.time)];
        return element("span", { class: this.#runs.indexOf(run) ? "second" : "first" }, at === null ? "" : number(value, 6));
      });
      values.replaceChildren(...told);
    }
    const event = at?.near;
    this.#hover.textContent =
      at === null
        ? "Point at a plot to read it; drag to zoom, double-click to see all."
        : `t = ${number(at.time, 6)}${event ? ` · ${event.kind.replaceAll("_", " ")} of ${event.of} at t = ${number(event.t, 9)}` : ""}`;
  }

  #zoomed(plot) {
    if (this.#syncing) return;
    const { min, max } = plot.scales.x;
    this.#zoom(min, max);
  }

  #zoom(min, max) {
    this.#syncing = true;
    this.#span = [min, max];
    for (const { plot } of this.#panels) {
      if (plot.scales.x.min !== min || plot.scales.x.max !== max) plot.setScale("x", { min, max });
    }
    // uPlot tells of a new scale after this task.
    queueMicrotask(() => queueMicrotask(() => (this.#syncing = false)));
  }

  #whole() {
    const starts = this.#runs.map((run) => run.t[0]);
    const ends = this.#runs.map((run) => run.t.at(-1));
    return [Math.min(...starts), Math.max(...ends)];
  }

  #key(event) {
    const plot = this.#panels[0]?.plot;
    if (!plot || event.ctrlKey || event.metaKey || event.altKey) return;
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
      for (const panel of this.#panels) panel.plot.setCursor({ left: to, top: HEIGHT / 2 });
    };
    const keys = {
      ArrowLeft: () => moved(-1),
      ArrowRight: () => moved(1),
      "+": () => scaled(0.5),
      "=": () => scaled(0.5),
      "-": () => scaled(2),
      0: () => this.#zoom(...this.#whole()),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }
}

// The columns of a field of all runs over all their times. A run of one moment becomes a point.
function columns(runs, field) {
  const tables = runs.map((run) => [run.t, run.fields[field]]);
  return tables.length === 1 ? tables[0] : uPlot.join(tables);
}

function nearestTo(times, time) {
  let [low, high] = [0, times.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return time - times[low] <= times[high] - time ? low : high;
}
