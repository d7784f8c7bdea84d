// Solves as fast as a slider is dragged: one request at a time, and after it the newest text, whatever came between. A request that takes
// long while a newer text waits is given up, and the service drops its work with it. No answer is shown that is older than one shown before.

import { Refused, solveNow } from "./service.js";

const LONGEST = 4; // seconds that a live solve may take
const PATIENCE = 300; // milliseconds that an older request may still take while a newer text waits

export class Live {
  #answer;
  #slow;
  #refused;
  #busy;
  #waiting = null; // the newest text, not yet asked for
  #going = null; // {text, controller, since}

  // `answer(answer, text)`, `slow(text)` and `refused(refusal, text)` are told what came of it; `busy(is)` whether anything is asked for.
  constructor({ answer, slow, refused, busy }) {
    [this.#answer, this.#slow, this.#refused, this.#busy] = [answer, slow, refused, busy];
  }

  solve(text) {
    this.#waiting = text;
    this.#busy(true);
    if (this.#going === null) return this.#next();
    if (this.#going.giveUp === null) {
      const { controller, since } = this.#going;
      this.#going.giveUp = setTimeout(() => controller.abort(), Math.max(0, PATIENCE - (performance.now() - since)));
    }
  }

  stop() {
    this.#waiting = null;
    this.#going?.controller.abort();
  }

  async #next() {
    const text = this.#waiting;
    const controller = new AbortController();
    const going = { text, controller, since: performance.now(), giveUp: null };
    [this.#going, this.#waiting] = [going, null];
    try {
      const answer = await solveNow(text, LONGEST, controller.signal);
      if (controller.signal.aborted) return;
      // The service solves the next text while the page draws this answer.
      this.#ended(going);
      if (answer === null) this.#slow(text);
      else this.#answer(answer, text);
    } catch (error) {
      if (controller.signal.aborted) return;
      if (!(error instanceof Refused)) throw error;
      if (this.#waiting === null) this.#refused(error, text);
    } finally {
      this.#ended(going);
      if (this.#going === null) this.#busy(false);
    }
  }

  // Nothing more comes of a request: the newest text is next. Told again of the same request, it does nothing.
  #ended(going) {
    clearTimeout(going.giveUp);
    if (this.#going !== going) return;
    this.#going = null;
    if (this.#waiting !== null) this.#next();
  }
}
