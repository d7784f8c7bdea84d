// The convex hull of a few points in space as triangles, counter-clockwise from outside: each face is spanned by
// three points that have all others on one side. Cubic in the number of points, which is at most `MOST` and mostly
// eight.

const MOST = 120; // largest number of points; of more points only some are used

export function hullOf(all) {
  const every = Math.ceil(all.length / MOST);
  const points = all.filter((_, i) => i % every === 0);
  const centre = [0, 1, 2].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
  const size = Math.max(...points.map((point) => Math.hypot(...minus(point, centre)))) || 1;
  const faces = [];
  const seen = new Set();
  for (let i = 0; i < points.length; i += 1) {
    for (let j = i + 1; j < points.length; j += 1) {
      for (let k = j + 1; k < points.length; k += 1) {
        let normal = cross(minus(points[j], points[i]), minus(points[k], points[i]));
        const length = Math.hypot(...normal);
        if (length < 1e-12 * size * size) continue;
        normal = normal.map((one) => one / length);
        const heights = points.map((point) => dot(normal, minus(point, points[i])));
        if (heights.every((height) => height <= 1e-9 * size)) addFace(normal, heights);
        else if (heights.every((height) => height >= -1e-9 * size)) addFace(normal.map((one) => -one), heights);
      }
    }
  }
  // Adds the face of the convex hull of all points in a plane, as a fan of triangles about its middle.
  function addFace(normal, heights) {
    const corners = points.map((_, i) => i).filter((i) => Math.abs(heights[i]) <= 1e-9 * size);
    const key = corners.join();
    if (seen.has(key)) return;
    seen.add(key);
    const middle = [0, 1, 2].map((axis) => corners.reduce((sum, i) => sum + points[i][axis], 0) / corners.length);
    const first = minus(points[corners[0]], middle);
    const second = cross(normal, first);
    const angle = (i) => Math.atan2(dot(second, minus(points[i], middle)), dot(first, minus(points[i], middle)));
    const round = [...corners].sort((a, b) => angle(a) - angle(b));
    round.forEach((corner, i) => faces.push([middle, points[corner], points[round[(i + 1) % round.length]]]));
  }
  return faces;
}

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
