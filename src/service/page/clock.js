// The time cursor that pictures and plots share: play, pause, speed, scrub, next event.
//
// A time horizon of about `LASTS` seconds is played in real time if the problem has seconds; any other horizon is
// played in `LASTS` seconds.

import { element } from "./element.js";
import { number } from "./numbers.js";

const LASTS = 8; // seconds in which a whole time horizon is played at speed 1
const STEPS = 1000; // number of positions of the slider

export class Clock {
  #from = 0;
  #to = 1;
  #time = 0;
  #events = [];
  #playing = false;
  #last = null;
  #told = [];
  #ended = null; // called when playing ends

  constructor(root) {
    this.play = element("button", { type: "button", click: () => this.toggle() }, "Play");
    this.slider = element("input", { type: "range", min: 0, max: STEPS, value: 0, "aria-label": "Time", input: () => this.#scrubbed() });
    this.speed = element(
      "select",
      { "aria-label": "Speed" },
      ...[0.1, 0.25, 0.5, 1, 2, 4].map((factor) => element("option", { value: factor, selected: factor === 1 }, `${factor}×`)),
    );
    this.next = element("button", { type: "button", click: () => this.nextEvent() }, "Next event");
    this.told = element("output", { class: "time" });
    root.replaceChildren(this.play, this.slider, this.speed, this.next, this.told);
  }

  // Calls `listener(time)` whenever the time of the cursor changes, until the returned function is called.
  listen(listener) {
    this.#told.push(listener);
    return () => (this.#told = this.#told.filter((one) => one !== listener));
  }

  // Plays the whole time horizon of the answer once; resolves when playing has ended or was paused.
  playThrough() {
    this.pause();
    this.go(this.#from);
    this.toggle();
    return new Promise((resolve) => (this.#ended = resolve));
  }

  get time() {
    return this.#time;
  }

  // Sets the time horizon and the events of a new answer; the time of the cursor is kept if it is inside. The picture
  // of the answer is drawn at that time by the caller of `set`, so that listeners are called only if the time or the
  // horizon has changed.
  set({ t, events }) {
    const same = this.#from === t[0] && this.#to === t.at(-1);
    [this.#from, this.#to] = [t[0], t.at(-1)];
    this.#events = [...new Set(events.map((event) => event.t))].sort((a, b) => a - b);
    this.next.disabled = this.#events.length === 0;
    const time = Math.min(this.#to, Math.max(this.#from, this.#time));
    if (!same || time !== this.#time) this.go(time);
  }

  // Resets the time cursor, since the next answer is that of another problem and begins at its start.
  reset() {
    this.pause();
    this.#time = -Infinity;
  }

  go(time) {
    this.#time = time;
    const part = (time - this.#from) / (this.#to - this.#from || 1);
    this.slider.value = Math.round(STEPS * part);
    this.slider.setAttribute("aria-valuetext", `t = ${number(time, 4)}`);
    this.told.textContent = `t = ${number(time, 4)}`;
    for (const listener of this.#told) listener(time);
  }

  toggle() {
    if (this.#playing) return this.pause();
    if (this.#time >= this.#to) this.go(this.#from);
    this.#playing = true;
    this.play.textContent = "Pause";
    this.#last = null;
    requestAnimationFrame((now) => this.#frame(now));
  }

  pause() {
    this.#playing = false;
    this.play.textContent = "Play";
    this.#ended?.();
    this.#ended = null;
  }

  nextEvent() {
    this.pause();
    const next = this.#events.find((time) => time > this.#time + 1e-12 * Math.abs(this.#time)) ?? this.#events[0];
    if (next !== undefined) this.go(next);
  }

  #frame(now) {
    if (!this.#playing) return;
    const passed = this.#last === null ? 0 : (now - this.#last) / 1000;
    this.#last = now;
    const rate = ((this.#to - this.#from) / LASTS) * Number(this.speed.value);
    this.go(Math.min(this.#to, this.#time + passed * rate));
    if (this.#time >= this.#to) return this.pause();
    requestAnimationFrame((next) => this.#frame(next));
  }

  #scrubbed() {
    this.pause();
    this.go(this.#from + (Number(this.slider.value) / STEPS) * (this.#to - this.#from));
  }
}
