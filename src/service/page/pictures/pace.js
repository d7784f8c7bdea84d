// Whether frames come fast enough, by the time from one to the next after something was drawn.

const SLOWEST = 24; // frames a second below which less is drawn
const FEWEST = 5; // frames that are judged together: those in which the browser prepares what it draws say nothing
const LONG = 400; // milliseconds that these take together at least

export class Pace {
  #slow;
  #waits = false;
  #frames = [];

  // Calls `slow()` where frames come more slowly than `SLOWEST` a second, again after as many more.
  constructor(slow) {
    this.#slow = slow;
  }

  // Something was drawn. What the browser does until it asks for the frame after the next is what it cost: a reader who stops costs nothing.
  frame() {
    if (this.#waits) return;
    this.#waits = true;
    requestAnimationFrame((from) =>
      requestAnimationFrame((to) => {
        this.#waits = false;
        this.#judge(to - from);
      }),
    );
  }

  // By the median: a page that was out of sight for a while has one long frame.
  #judge(time) {
    this.#frames.push(time);
    const sum = this.#frames.reduce((all, one) => all + one, 0);
    if (this.#frames.length < FEWEST || sum < LONG) return;
    const median = this.#frames.sort((a, b) => a - b)[this.#frames.length >> 1];
    this.#frames = [];
    if (median > 1000 / SLOWEST) this.#slow();
  }
}
