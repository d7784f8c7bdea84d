// Where the picture of an answer stands: its film is solved for beside the answer, and drawn at the time of the cursor.
//
// A film costs about what the answer did. Where that was long, it is asked for by a button.

import { element } from "./element.js";
import { seconds } from "./numbers.js";
import { pictureOf } from "./pictures/index.js";
import { Refused, solveNow } from "./service.js";

const AT_ONCE = 1.5; // seconds that an answer may have taken whose film is made unasked
const LONGEST = 60; // seconds that a film may take

export class Stage {
  #root;
  #place;
  #hint;
  #clock;
  #picture = null; // {element, draw, dispose, hint}
  #asked = null; // the controller of the film on its way
  #of = ""; // the specification of the film that is shown

  constructor(root, place, hint, clock) {
    [this.#root, this.#place, this.#hint, this.#clock] = [root, place, hint, clock];
  }

  clear() {
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

  // The picture of a run, made anew only where the specification is another.
  show(run) {
    const { specification } = run;
    const kind = run.t.length > 1 && run.study === undefined ? pictureOf(specification) : null;
    const film = kind?.needs(specification) ?? null;
    if (film === null) return this.clear();
    const text = JSON.stringify(film);
    if (text === this.#of) return this.draw(this.#clock.time);
    const cost = run.diagnostics.wall_seconds ?? 0;
    if (cost <= AT_ONCE) return this.#make(kind, specification, text);
    this.clear();
    this.#root.hidden = false;
    const make = () => this.#make(kind, specification, text);
    this.#place.replaceChildren(element("button", { type: "button", click: make }, `Draw the picture (solves again, about ${seconds(cost)})`));
  }

  async #make(kind, specification, text) {
    this.#asked?.abort();
    const controller = new AbortController();
    this.#asked = controller;
    if (this.#picture === null) {
      this.#root.hidden = false;
      this.#place.replaceChildren(element("p", { class: "hint" }, "The picture is on its way ..."));
    }
    try {
      const answer = await solveNow(text, LONGEST, controller.signal);
      if (controller.signal.aborted) return;
      if (answer === null) return this.#say("The picture takes longer than a minute, and is left out.");
      const bundle = (name) => new URL(`./vendor/${name}`, import.meta.url).href;
      const picture = await kind.make(specification, { ...answer.trajectory }, { bundle });
      if (controller.signal.aborted) return picture?.dispose();
      if (picture === null) return this.clear();
      this.#picture?.dispose();
      this.#picture = picture;
      this.#of = text;
      this.#root.hidden = false;
      this.#place.replaceChildren(picture.element);
      this.#hint.textContent = picture.hint;
      picture.draw(this.#clock.time);
    } catch (error) {
      if (controller.signal.aborted) return;
      this.#say(error instanceof Refused ? `There is no picture: ${error.message}` : error.message);
    }
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
