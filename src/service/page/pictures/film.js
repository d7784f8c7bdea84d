// A film: an answer at the times of frames, of the same problem, and the values between two of them.

// A specification without what a film does not need.
export function film({ label, study, sweep, fit, sensitivities, ...rest }) {
  return rest;
}

// The frame before a time, and how far it is to the next.
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
