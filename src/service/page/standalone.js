// An answer as one HTML file, which needs neither the network nor the service: its moving picture, its plots, its
// claims and its specification.

import { element } from "./element.js";

const FRAMES = 80;
const QUALITY = 0.85; // quality of the WebP image of a frame, from 0 to 1
const LASTS = 8000; // milliseconds in which the frames are played
const STYLE = `:root { color-scheme: light dark; font: 15px/1.5 system-ui, sans-serif; } body { max-width: 52rem; margin: 1.5rem auto; padding: 0 1rem; }
img, svg { max-width: 100%; height: auto; } input { width: 60%; vertical-align: middle; } pre { overflow: auto; } ul { list-style: none; padding: 0; } .light, .badge, .badge span { margin-right: .5em; }`;
const PLAYER = `const [picture, slider, play, told] = ["picture", "time", "play", "told"].map((id) => document.getElementById(id));
let since = null;
const show = (k) => { slider.value = k; picture.src = frames[k]; told.textContent = "t = " + Number(times[k].toPrecision(4)); };
const step = (now) => {
  if (since === null) return;
  show(Math.floor((Math.max(0, now - since) / ${LASTS}) * frames.length) % frames.length);
  requestAnimationFrame(step);
};
slider.addEventListener("input", () => { since = null; play.textContent = "Play"; show(Number(slider.value)); });
play.addEventListener("click", () => {
  since = since === null ? performance.now() - (Number(slider.value) / frames.length) * ${LASTS} : null;
  play.textContent = since === null ? "Play" : "Pause";
  requestAnimationFrame(step);
});
show(0);`;

// Copies the canvas of a picture, which is transparent on the page, onto a background. The copy is made at once, since
// the drawing buffer of a scene is kept for one frame only.
export function flattened(canvas, background) {
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const context = copy.getContext("2d");
  context.fillStyle = background;
  context.fillRect(0, 0, copy.width, copy.height);
  context.drawImage(canvas, 0, 0);
  return copy;
}

export const still = (canvas, background) => new Promise((resolve) => flattened(canvas, background).toBlob(resolve, "image/png"));

// `canvas` may be null; `draw(time)` draws the picture on it. `verdict` and `claims` are elements of the page, whose
// links are removed, since they would lead nowhere in a file.
export function standalone({ title, text, t, canvas, draw, background, figure, verdict, claims }) {
  const file = document.implementation.createHTMLDocument(title);
  const unlinked = (part) => {
    const copy = part.cloneNode(true);
    for (const link of copy.querySelectorAll("a")) link.remove();
    return copy;
  };
  file.head.append(element("meta", { name: "viewport", content: "width=device-width" }));
  file.head.prepend(element("meta", { charset: "utf-8" }));
  const player = [];
  if (canvas) {
    const times = Array.from({ length: FRAMES }, (_, k) => t[0] + ((t.at(-1) - t[0]) * k) / (FRAMES - 1));
    const frames = times.map((time) => (draw(time), flattened(canvas, background).toDataURL("image/webp", QUALITY)));
    file.body.append(
      element("p", {}, element("img", { id: "picture", alt: `${title} at the time of the slider` })),
      element(
        "p",
        {},
        element("button", { id: "play", type: "button" }, "Play"),
        " ",
        element("input", { id: "time", type: "range", min: 0, max: FRAMES - 1, value: 0, "aria-label": "Time" }),
        " ",
        element("output", { id: "told" }),
      ),
    );
    player.push(element("script", {}, `const times = ${JSON.stringify(times)}, frames = ${JSON.stringify(frames)};\n${PLAYER}`));
  }
  file.body.prepend(element("h1", {}, title), unlinked(verdict));
  file.body.append(figure, unlinked(claims), element("h2", {}, "Specification"), element("pre", {}, text), ...player);
  // The style is added to the text of the file, since the content security policy of the page would refuse a style
  // element in a document.
  const styled = file.documentElement.outerHTML.replace("</head>", () => `<style>${STYLE}</style></head>`);
  return new Blob([`<!doctype html>\n${styled}`], { type: "text/html" });
}
