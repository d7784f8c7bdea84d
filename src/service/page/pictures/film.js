// A film: the answer of a problem at the times of frames, with interpolation between two frames.

// Returns a specification without the parts that the solve for a film does not need.
export function film({ label, study, sweep, fit, sensitivities, ...rest }) {
  return rest;
}

// Returns the index of the film's frame before a time, and the fraction of the way to the next frame.
export function between(times, time) {
  let [low, high] = [0, times.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  const part = (time - times[low]) / (times[high] - times[low] || 1);
  return { k: low, part: Math.min(1, Math.max(0, part)) };
}

export const mixed = (column, k, next, part) => column[k] + part * (column[next] - column[k]);
