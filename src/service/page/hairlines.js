// A wide line composed of lines that are one pixel wide: a processor fills the outline of a wide line ten times as
// slowly as it draws these.
//
// Side by side, a little less than a pixel apart, they cover exactly what the wide line covers if it is level or
// upright, and nearly that otherwise.

// Returns the path of the hairlines that replace `path` at a width of `pixels`, to be drawn one pixel wide. The wide
// line is taken to be drawn with its edges on those of pixels: shifted to the right and down by half of its width, up
// to a whole pixel.
export function hairlines(path, pixels) {
  const count = Math.max(1, Math.ceil(pixels));
  const apart = count > 1 ? (pixels - 1) / (count - 1) : 0;
  const first = (pixels % 2) / 2 - pixels / 2;
  const lines = new Path2D();
  for (let k = 0; k < count; k += 1) lines.addPath(path, new DOMMatrix([1, 0, 0, 1, first + k * apart, first + k * apart]));
  return lines;
}
