// The comparison of two runs: the difference of a field of one run from the same field of the other.

// Returns the largest difference between the columns `a` over times `s` and `b` over times `t`, at the times `s`
// within the range of `t`; if the times differ, `b` is interpolated linearly. Null if the time ranges do not overlap.
export function largestDifference(s, a, t, b) {
  let largest = null;
  let right = 0;
  for (let i = 0; i < s.length; i += 1) {
    while (right < t.length && t[right] < s[i]) right += 1;
    if (right === t.length || (right === 0 && t[0] > s[i])) continue;
    let value = b[right];
    if (t[right] > s[i]) {
      const part = (s[i] - t[right - 1]) / (t[right] - t[right - 1]);
      value = b[right - 1] + part * (b[right] - b[right - 1]);
    }
    const difference = Math.abs(a[i] - value);
    if (largest === null || difference > largest) largest = difference;
  }
  return largest;
}
