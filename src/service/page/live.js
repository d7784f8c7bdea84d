// Live solves while a slider is dragged: one request at a time, and after it the newest text, skipping those in
// between. A request that takes long while a newer text waits is aborted, and the service drops its work. No answer
// is shown that is older than one shown before.

import { Refused, solveNow } from "./service.js";

const LONGEST = 4; // seconds that a live solve may take
const PATIENCE = 300; // milliseconds that an older request may still take while a newer text waits

export class Live {
  #answer;
  #slow;
  #refused;
  #busy;
  #waiting = null; // the newest text, which has not been requested yet
  #going = null; // the pending request, {text, controller, since}

  // `answer(answer, text)`, `slow(text)` and `refused(refusal, text)` are called with the outcome of a request for a
  // solve; `busy(is)` is called when requests begin and end.
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
      // The next text of the specification is requested first, so that the service solves it while the page draws this
      // answer.
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

  // Ends a request for a solve and sends the newest text of the specification. A second call for the same request does
  // nothing.
  #ended(going) {
    clearTimeout(going.giveUp);
    if (this.#going !== going) return;
    this.#going = null;
    if (this.#waiting !== null) this.#next();
  }
}
