// Small pictures on the cards of the gallery. An example is solved when its card comes into view, one example at a
// time, and its picture is drawn; the picture moves while the pointer or the focus is on the card. Nothing is fetched
// for scenes in space, of which curves are drawn.

import { element } from "./element.js";
import { isConstant, range } from "./fields.js";
import { film } from "./pictures/film.js";
import { load, pictureOf } from "./pictures/index.js";
import { dot, line, surface } from "./pictures/surface.js";
import { example, Refused, solveNow } from "./service.js";

const LONGEST = 2; // seconds that the solve for a small picture may take
const STILL = 0.4; // fraction of the time horizon at which a picture that does not move is drawn
const LASTS = 4000; // milliseconds in which the time horizon is played
const POINTS = 241; // number of points of a curve
const CURVES = 3;
const [WIDTH, HEIGHT] = [270, 140]; // pixels of a picture; circuits are as large as their netlists

export class Previews {
  #bench = element("div", { class: "bench", "aria-hidden": "true" });
  #known = new Map(); // the solved examples: card to {kind, run}, null if there is no picture
  #waiting = []; // cards in view whose examples are not solved yet
  #going = null; // the example being solved, {card, controller}
  #refused = false;

  // `root` contains the cards of the gallery, each with a canvas and the name of its example.
  constructor(root) {
    root.append(this.#bench);
    const observer = new IntersectionObserver((entries) => entries.forEach(({ target, isIntersecting }) => (isIntersecting ? this.#enter(target) : this.#leave(target))));
    const cards = [...root.querySelectorAll(".card")];
    for (const card of cards) {
      observer.observe(card);
      for (const kind of ["pointerenter", "focus"]) card.addEventListener(kind, () => this.#play(card));
    }
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#known.forEach((one, card) => one && this.#still(card)));
  }

  #enter(card) {
    if (this.#known.has(card) || this.#refused) return;
    this.#waiting.push(card);
    if (this.#going === null) this.#next();
  }

  #leave(card) {
    this.#waiting = this.#waiting.filter((one) => one !== card);
    if (this.#going?.card === card) this.#going.controller.abort();
  }

  async #next() {
    const card = this.#waiting.shift();
    if (card === undefined) return;
    const { signal } = (this.#going = { card, controller: new AbortController() }).controller;
    try {
      const found = await solved(card.dataset.example, signal);
      this.#known.set(card, found);
      if (found) await this.#still(card);
    } catch (error) {
      // The error is not shown here: another part of the page reports why the service refuses requests.
      if (!signal.aborted) this.#refused = error instanceof Refused;
    }
    this.#going = null;
    if (!this.#refused) this.#next();
  }

  // Calls `act` with a function that draws the picture of a card of the gallery at a given fraction of its time
  // horizon.
  async #drawn(card, act) {
    const { kind, run } = this.#known.get(card);
    const picture = (await kind?.make(run.specification, run, {})) ?? curves(run);
    if (pictureOf(run.specification) !== "circuit") Object.assign(picture.element.style, { width: `${WIDTH}px`, height: `${HEIGHT}px` });
    this.#bench.append(picture.element);
    const canvas = card.querySelector("canvas");
    try {
      await act((part) => {
        picture.draw(run.t[0] + part * (run.t.at(-1) - run.t[0]));
        const { width, height } = picture.element;
        if (picture.element.clientWidth === 0) return; // the gallery is out of view
        Object.assign(canvas, { width, height, hidden: false });
        canvas.getContext("2d").drawImage(picture.element, 0, 0);
      });
    } finally {
      picture.dispose();
      picture.element.remove();
    }
  }

  #still(card) {
    return this.#drawn(card, (draw) => draw(STILL));
  }

  async #play(card) {
    if (!this.#known.get(card) || card.dataset.plays || matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    card.dataset.plays = true;
    const since = performance.now();
    await this.#drawn(card, async (draw) => {
      while (card.matches(":hover, :focus")) {
        const now = await new Promise(requestAnimationFrame);
        draw((STILL + Math.max(0, now - since) / LASTS) % 1);
      }
      draw(STILL);
    });
    delete card.dataset.plays;
  }
}

// Returns the run of an example, and the kind of its picture; null if the solve takes long or nothing moves.
async function solved(name, signal) {
  const text = await example(name);
  const specification = JSON.parse(text);
  const picture = pictureOf(specification);
  const kind = picture === null || picture === "scene" ? null : await load(picture);
  const wanted = kind?.needs(specification) ?? { ...film(specification), output: { times: { count: POINTS } } };
  if (signal.aborted) throw signal.reason;
  const answer = await solveNow(JSON.stringify(wanted), LONGEST, signal, { quiet: true });
  const run = answer && { events: [], ...answer.trajectory, specification };
  return run?.t?.length > 2 ? { kind, run } : null;
}

// Draws the curves of the first fields of a run that change, each over its own range.
function curves({ t, fields }) {
  const shown = Object.values(fields).filter((values) => values.every(Number.isFinite) && !isConstant(range(values))).slice(0, CURVES);
  let time = t[0];
  const paint = (context, { width, height, colour }) => {
    const x = (at) => 10 + ((width - 20) * (at - t[0])) / (t.at(-1) - t[0]);
    const now = Math.max(0, t.findLastIndex((at) => at <= time));
    shown.forEach((values, i) => {
      const [low, high] = range(values);
      const y = (value) => height - 14 - ((height - 28) * (value - low)) / (high - low);
      line(context, t.map((at, k) => [x(at), y(values[k])]), colour(`--line-${i}`), 2);
      dot(context, x(t[now]), y(values[now]), 6, colour(`--line-${i}`));
    });
  };
  const { canvas, redraw, dispose } = surface("", HEIGHT, paint);
  return { element: canvas, dispose, draw: (to) => ((time = to), redraw()) };
}
