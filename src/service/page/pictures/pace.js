// Measures whether frames are drawn fast enough, by the time between frames after something was drawn.

const SLOWEST = 24; // frames per second below which less is drawn
const FEWEST = 5; // number of frames that are judged together: while the browser prepares what it draws, single frames say nothing
const LONG = 400; // least total time of the frames judged together, in milliseconds

export class Pace {
  #slow;
  #waits = false;
  #frames = [];

  // Calls `slow()` whenever the frames that are measured together were drawn at less than `SLOWEST` per second.
  constructor(slow) {
    this.#slow = slow;
  }

  // Measures a frame in which something was drawn: its cost is the time between the next two frames. While nothing is
  // drawn, nothing is measured.
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

  // Compares the median time of a frame with the limit: a page that was out of view for a while has one long frame.
  #judge(time) {
    this.#frames.push(time);
    const sum = this.#frames.reduce((all, one) => all + one, 0);
    if (this.#frames.length < FEWEST || sum < LONG) return;
    const median = this.#frames.sort((a, b) => a - b)[this.#frames.length >> 1];
    this.#frames = [];
    if (median > 1000 / SLOWEST) this.#slow();
  }
}
