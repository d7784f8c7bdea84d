// A heat map over two numbers of a problem: a sweep over a grid of their values, one colour per run. A click on a
// cell opens its run.

import { element } from "./element.js";
import { svg } from "./figure.js";
import { nameInSweep, rounded } from "./knobs.js";
import { number } from "./numbers.js";
import { Refused, solveNow } from "./service.js";

const CELLS = 15; // number of cells along each side
const LONGEST = 30; // seconds that the solve of a map may take
const REDUCERS = [["final", "at the end"], ["max", "largest"], ["min", "least"], ["mean", "mean"]];
const [LEFT, TOP, SIZE, BAR] = [66, 12, 18, 14]; // pixels: left and top margin, a cell, the colour bar
// Colours from dark to light whose order everyone can see (viridis: S. van der Walt and N. Smith 2015), in five
// stops.
const COLOURS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

const grid = ({ low, high }) => Array.from({ length: CELLS }, (_, k) => rounded(low + ((high - low) * k) / (CELLS - 1)));

export function colourAt(part) {
  const at = Math.min(Math.max(part, 0), 1) * (COLOURS.length - 1);
  const k = Math.min(Math.floor(at), COLOURS.length - 2);
  const mixed = COLOURS[k].map((from, i) => Math.round(from + (COLOURS[k + 1][i] - from) * (at - k)));
  return `rgb(${mixed.join(" ")})`;
}

export class HeatMap {
  #knobs;
  #specification;
  #open;
  #asked = null;

  // `knobs()` lists the adjustable numbers of the specification with their ranges; `specification()` returns the
  // current specification; `open(list)` is called with the [pointer, value] of both numbers of a cell.
  constructor(root, { knobs, specification, open }) {
    [this.#knobs, this.#specification, this.#open] = [knobs, specification, open];
    const select = (label) => element("select", { "aria-label": label });
    [this.across, this.up, this.field] = [select("Across"), select("Up"), select("Of the field")];
    this.reducer = element("select", { "aria-label": "Collected" }, ...REDUCERS.map(([name, words]) => element("option", { value: name }, words)));
    this.button = element("button", { type: "button", click: () => this.#draw() }, "Draw the map");
    this.told = element("p", { class: "hint", role: "status" });
    this.place = element("div");
    const row = (...parts) => element("div", { class: "row" }, ...parts);
    root.append(row("Across", this.across, "up", this.up), row("colour", this.field, this.reducer, this.button), this.told, this.place);
  }

  // Offers as choices the numbers of the specification that a sweep can name, and the fields of an answer; a choice
  // that is still valid stays.
  offer(known, fields) {
    const put = (select, options, place) => {
      const before = select.value;
      select.replaceChildren(...options.map(([value, words]) => element("option", { value }, words)));
      select.value = options.some(([value]) => value === before) ? before : (options[place]?.[0] ?? "");
    };
    const options = known.map(({ pointer, name }) => [pointer, name]);
    put(this.across, options, 0);
    put(this.up, options, 1);
    put(this.field, fields.map((name) => [name, name]), 0);
  }

  async #draw() {
    const specification = this.#specification();
    const of = (select) => this.#knobs().find(({ pointer }) => pointer === select.value);
    const [across, up] = [of(this.across), of(this.up)];
    if (!specification || !across || !up || across === up || across.pointer === up.pointer) {
      this.told.textContent = "Choose two different numbers.";
      return;
    }
    const names = [across, up].map((knob) => nameInSweep(knob, specification));
    const values = [grid(across), grid(up)];
    const { study, fit, output, sensitivities, ...rest } = specification;
    const over = Object.fromEntries(names.map((name, i) => [name, values[i]]));
    const text = JSON.stringify({ ...rest, sweep: { over, collect: { value: { [this.reducer.value]: this.field.value } } } });
    this.#asked?.abort();
    const controller = (this.#asked = new AbortController());
    this.told.textContent = `Solving ${CELLS * CELLS} times ...`;
    try {
      const answer = await solveNow(text, LONGEST, controller.signal);
      if (controller.signal.aborted) return;
      if (answer?.table === undefined) {
        this.told.textContent = `The map takes longer than ${LONGEST} s, and is left out.`;
        return;
      }
      this.#show(answer.table.columns, names, values, [across, up]);
    } catch (error) {
      if (controller.signal.aborted) return;
      if (!(error instanceof Refused)) throw error;
      this.told.textContent = error.problem.errors?.[0]?.detail ?? error.message;
    }
  }

  #show(columns, names, values, knobs) {
    const cells = new Map();
    columns.value.forEach((value, row) => cells.set(names.map((name, i) => values[i].indexOf(columns[name][row])).join(), value));
    const known = [...cells.values()].filter((value) => value !== null);
    if (known.length === 0) {
      this.told.textContent = "None of the runs reached its end.";
      return;
    }
    const [low, high] = [Math.min(...known), Math.max(...known)];
    const part = (value) => (high > low ? (value - low) / (high - low) : 0.5);
    const side = CELLS * SIZE;
    const rects = [];
    for (let i = 0; i < CELLS; i += 1) {
      for (let j = 0; j < CELLS; j += 1) {
        const value = cells.get(`${i},${j}`) ?? null;
        const place = { x: LEFT + i * SIZE, y: TOP + (CELLS - 1 - j) * SIZE, width: SIZE, height: SIZE };
        rects.push(svg("rect", { ...place, fill: value === null ? "none" : colourAt(part(value)), "data-cell": `${i},${j}` }));
      }
    }
    const words = (x, y, said, anchor = "middle") => svg("text", { x, y, "text-anchor": anchor, class: "axis" }, said);
    const bar = Array.from({ length: 50 }, (_, k) => svg("rect", { x: LEFT + side + 16, y: TOP + side * (1 - (k + 1) / 50), width: BAR, height: side / 50 + 0.5, fill: colourAt(k / 49) }));
    const marker = svg("rect", { width: SIZE, height: SIZE, class: "cursor" });
    const figure = svg(
      "svg",
      { viewBox: `0 0 ${LEFT + side + 110} ${TOP + side + 44}`, class: "heatmap", tabindex: 0, role: "application", "aria-label": "Heat map: arrow keys move, Enter opens the run" },
      ...rects,
      marker,
      ...bar,
      words(LEFT, TOP + side + 16, number(values[0][0], 3), "start"),
      words(LEFT + side, TOP + side + 16, number(values[0].at(-1), 3), "end"),
      words(LEFT + side / 2, TOP + side + 34, knobs[0].name),
      words(LEFT - 6, TOP + side, number(values[1][0], 3), "end"),
      words(LEFT - 6, TOP + 10, number(values[1].at(-1), 3), "end"),
      words(LEFT - 6, TOP + side / 2, knobs[1].name, "end"),
      words(LEFT + side + 36, TOP + side, number(low, 3), "start"),
      words(LEFT + side + 36, TOP + 10, number(high, 3), "start"),
    );
    let cell = [0, 0];
    const mark = () => {
      marker.setAttribute("x", LEFT + cell[0] * SIZE);
      marker.setAttribute("y", TOP + (CELLS - 1 - cell[1]) * SIZE);
    };
    mark();
    const move = (to) => {
      cell = to.map((k) => Math.min(Math.max(k, 0), CELLS - 1));
      mark();
      const value = cells.get(cell.join()) ?? null;
      const where = knobs.map((knob, i) => `${knob.name} = ${number(values[i][cell[i]], 4)}`).join(", ");
      this.told.textContent = `${where}: ${value === null ? "no answer" : number(value, 5)}`;
    };
    const open = () => this.#open(knobs.map((knob, i) => [knob, values[i][cell[i]]]));
    const cellOf = (event) => event.target.dataset.cell?.split(",").map(Number);
    figure.addEventListener("pointermove", (event) => cellOf(event) && move(cellOf(event)));
    figure.addEventListener("click", (event) => {
      if (cellOf(event)) move(cellOf(event));
      open();
    });
    figure.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[event.key];
      if (event.key === "Enter") open();
      else if (step) move(cell.map((k, i) => k + step[i]));
      else return;
      event.preventDefault();
    });
    this.place.replaceChildren(figure);
    const missing = CELLS * CELLS - known.length;
    this.told.textContent = `From ${number(low, 4)} to ${number(high, 4)}${missing > 0 ? `; ${missing} runs have no answer` : ""}. A click opens a run.`;
  }
}
