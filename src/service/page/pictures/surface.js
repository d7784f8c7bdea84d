// A canvas for pictures in a plane: it follows its size on the page and the screen's resolution, and uses the page's
// colours.

import { colourOf } from "../colours.js";
import { element } from "../element.js";

const widths = new WeakMap(); // the last known widths of canvases: reading a width from the document would force a layout of all that has changed

// `paint(context, {width, height, colour})` draws in CSS pixels; the returned `redraw()` draws again. The canvas is
// `tall` pixels high unless its style says otherwise. An existing canvas can be given, which is then reused.
export function surface(label, tall, paint, canvas = element("canvas", { role: "img" })) {
  canvas.setAttribute("aria-label", label);
  canvas.style.height = `${tall}px`;
  const colour = (name) => colourOf(name) || "#888888";
  const redraw = () => {
    const width = widths.get(canvas) || canvas.clientWidth;
    if (width === 0) return;
    widths.set(canvas, width);
    const height = parseFloat(canvas.style.height);
    const scale = Math.min(devicePixelRatio, 2);
    const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const context = canvas.getContext("2d");
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = "12px system-ui, sans-serif";
    paint(context, { width, height, colour });
  };
  const observer = new ResizeObserver(() => {
    if (canvas.clientWidth === widths.get(canvas)) return;
    widths.set(canvas, canvas.clientWidth);
    redraw();
  });
  observer.observe(canvas);
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  scheme.addEventListener("change", redraw);
  const dispose = () => {
    observer.disconnect();
    scheme.removeEventListener("change", redraw);
  };
  return { canvas, redraw, dispose };
}

// Returns a map from a box of the plane to pixels, with equal units along both axes unless `stretch`; y grows
// upwards.
export function fitted([xs, ys], { width, height }, room = 24, stretch = false) {
  const [wide, high] = [xs[1] - xs[0] || 1, ys[1] - ys[0] || 1];
  let [sx, sy] = [(width - 2 * room) / wide, (height - 2 * room) / high];
  if (!stretch) sx = sy = Math.min(sx, sy);
  const [mx, my] = [(xs[0] + xs[1]) / 2, (ys[0] + ys[1]) / 2];
  return {
    x: (x) => width / 2 + (x - mx) * sx,
    y: (y) => height / 2 - (y - my) * sy,
    sx,
    sy,
  };
}

export function line(context, points, colour, width = 1.6, dash = []) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  points.forEach(([x, y], i) => (i === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
  context.stroke();
  context.setLineDash([]);
}

export function dot(context, x, y, radius, colour) {
  context.fillStyle = colour;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
}
