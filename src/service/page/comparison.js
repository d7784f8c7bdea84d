// Two runs, side by side: how far a field of one is from the same field of the other.

// The largest difference between the columns `a` over times `s` and `b` over times `t`, over the times of both; where
// the times differ, the line through the neighbours of `b` is taken. Nothing if the times have none in common.
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
