// The place of the picture of an answer: the frames of its film are computed by a further solve, and drawn at the
// time of the cursor.
//
// A film costs about as much as its answer. If the answer took long, the film is computed only on request, by a
// button.

import { element } from "./element.js";
import { seconds } from "./numbers.js";
import { load, pictureOf } from "./pictures/index.js";
import { Refused, solveNow } from "./service.js";

const AT_ONCE = 1.5; // seconds that an answer may have taken for its film to be computed without request
const PAUSE = 150; // milliseconds without a newer answer before a film is computed
const FRAMES = 100; // number of times from which an answer is drawn as a film without a further solve
const LONGEST = 60; // seconds that the solve of a film may take
const FOLLOWS = 50; // milliseconds between two pictures while a slider is dragged

export class Stage {
  #root;
  #place;
  #hint;
  #clock;
  #picture = null; // the picture in view, {element, draw, dispose, hint}
  #asked = null; // the controller of the pending request for a film
  #kinds = new Map();
  #name = null; // the name of the kind of picture that is shown
  #wanted = null; // the run whose picture is wanted
  #later = null;
  #of = ""; // the specification of the film that is shown, as text
  #followed = -Infinity; // the time at which the picture last followed a slider

  constructor(root, place, hint, clock) {
    [this.#root, this.#place, this.#hint, this.#clock] = [root, place, hint, clock];
  }

  clear() {
    this.#wanted = null;
    clearTimeout(this.#later);
    this.#asked?.abort();
    this.#picture?.dispose();
    this.#picture = null;
    this.#of = "";
    this.#root.hidden = true;
    this.#place.replaceChildren();
    this.#hint.textContent = "";
  }

  draw(time) {
    this.#picture?.draw(time);
  }

  // Shows the picture of a run, which is computed anew only if the specification has changed.
  show(run) {
    const { specification } = run;
    const name = run.t.length > 1 && !run.study ? pictureOf(specification) : null;
    if (name !== this.#name) this.clear(); // the picture is of another kind
    [this.#name, this.#wanted] = [name, run];
    if (name !== null && !this.#kinds.has(name)) return this.#fetch(name, run);
    const kind = this.#kinds.get(name);
    const film = kind?.needs(specification) ?? null;
    if (film === null) return this.clear();
    const text = JSON.stringify(film);
    if (text === this.#of) return this.draw(this.#clock.time);
    clearTimeout(this.#later);
    if (serves(run, film)) {
      this.#asked?.abort();
      this.#asked = null;
      return this.#put(kind, run, text).catch((error) => this.#say(`There is no picture: ${error.message}`));
    }
    const cost = run.diagnostics.wall_seconds ?? 0;
    const make = () => this.#make(kind, specification, text);
    if (cost <= AT_ONCE) {
      // If a slider is about to move again, the solves for its values come first: the solve for the film of the picture
      // is delayed.
      this.#later = setTimeout(make, this.#picture === null ? 0 : PAUSE);
      return;
    }
    this.clear();
    this.#root.hidden = false;
    this.#place.replaceChildren(element("button", { type: "button", click: make }, `Draw the picture (solves again, about ${seconds(cost)})`));
  }

  // While a slider is dragged, draws some of the answers to its values, if an answer contains all that its film would
  // contain. The last answer is drawn when the slider rests.
  follow(run) {
    clearTimeout(this.#later);
    const now = performance.now();
    if (now - this.#followed < FOLLOWS) return;
    const film = this.#kinds.get(this.#name)?.needs(run.specification);
    if (!film || !serves(run, film)) return;
    this.#followed = now;
    this.show(run);
  }

  async #make(kind, specification, text) {
    this.#asked?.abort();
    const controller = new AbortController();
    this.#asked = controller;
    if (this.#picture === null) {
      this.#root.hidden = false;
      this.#place.replaceChildren(element("p", { class: "hint" }, "The picture is being drawn ..."));
    }
    try {
      const answer = await solveNow(text, LONGEST, controller.signal);
      if (controller.signal.aborted) return;
      if (answer === null) return this.#say("The picture takes longer than a minute, and is left out.");
      await this.#put(kind, { ...answer.trajectory, specification }, text, controller.signal);
    } catch (error) {
      if (controller.signal.aborted) return;
      this.#say(error instanceof Refused ? `There is no picture: ${error.message}` : error.message);
    }
  }

  // Fetches the script of a kind of picture, and shows the picture of the run if it is still wanted.
  async #fetch(name, run) {
    try {
      this.#kinds.set(name, await load(name));
      if (this.#wanted === run) this.show(run);
    } catch (error) {
      if (this.#wanted === run) this.#say(`There is no picture: ${error.message}`);
    }
  }

  // Draws the picture of a run, unless `signal` is aborted meanwhile.
  async #put(kind, run, text, signal = null) {
    const bundle = (name) => new URL(`./vendor/${name}`, import.meta.url).href;
    // While a slider is dragged, keeping the canvas of the picture spares the page a new layout for each answer.
    const picture = await kind.make(run.specification, run, { bundle, canvas: this.#picture?.element });
    if (signal?.aborted) return picture?.dispose();
    if (picture === null) return this.clear();
    this.#picture?.dispose();
    this.#picture = picture;
    this.#of = text;
    this.#root.hidden = false;
    if (picture.element.parentNode !== this.#place) this.#place.replaceChildren(picture.element);
    if (this.#hint.textContent !== picture.hint) this.#hint.textContent = picture.hint;
    picture.draw(this.#clock.time);
  }

  #say(words) {
    this.#picture?.dispose();
    this.#picture = null;
    this.#of = "";
    this.#root.hidden = false;
    this.#place.replaceChildren(element("p", { class: "hint" }, words));
    this.#hint.textContent = "";
  }
}

// Whether an answer contains all that its film would contain.
function serves(run, film) {
  if (run.t.length < FRAMES || JSON.stringify(film.problem) !== JSON.stringify(run.specification.problem)) return false;
  const [problem] = Object.values(film.problem);
  const fields = film.output.fields ?? Object.keys(problem.states ?? problem.coordinates ?? {});
  return fields.every((field) => run.fields[field] !== undefined);
}
