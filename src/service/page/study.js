// Error against run time: the picture of a study, and a table of its numbers.

import { element } from "./element.js";
import { number, seconds } from "./numbers.js";

// The picture of the study is shown as an image, so that no script in it can run.
export function study({ reference, series, picture }) {
  const image = new Blob([picture], { type: "image/svg+xml" });
  const address = URL.createObjectURL(image);
  const shown = element("img", { src: address, alt: "Error against run time; the numbers are in the table below" });
  for (const event of ["load", "error"]) shown.addEventListener(event, () => URL.revokeObjectURL(address));
  const head = ["method", "tolerance or step", "steps", "run time", "error at the end", "order", "trusted"];
  const rows = series.flatMap(({ method, runs }) => runs.map((run) => [method, ...told(run)]));
  const table = element(
    "table",
    {},
    element("caption", {}, `Errors against ${reference}`),
    element("thead", {}, element("tr", {}, ...head.map((name) => element("th", { scope: "col" }, name)))),
    element("tbody", {}, ...rows.map((cells) => element("tr", {}, ...cells.map((cell) => element("td", {}, cell))))),
  );
  return [shown, element("details", {}, element("summary", {}, "Numbers of the study"), table)];
}

const told = (run) => [
  number(run.rtol ?? run.step, 3),
  number(run.steps),
  seconds(run.wall_seconds),
  run.status === "completed" ? maybe(run.error_at_end, 2) : run.status,
  maybe(run.order, 3),
  verdict(run.trusted),
];

const verdict = (trusted) =>
  trusted === false ? element("strong", { class: "bad" }, "no") : trusted === true ? "yes" : "–";

const maybe = (value, digits) => (value == null ? "–" : number(value, digits));
