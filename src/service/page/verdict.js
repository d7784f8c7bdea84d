// The verdict on an answer, which stands above the rest of it: a badge; what speaks against the answer, each value
// beside the allowed one; and remarks that do not speak against it.

import { sentenceOf } from "./claims.js";
import { element } from "./element.js";
import { measured } from "./numbers.js";

// Returns the verdict on one run, or on two runs to be compared, as elements.
export function verdicts(runs) {
  const whose = runs.length > 1 ? [" (first)", " (second)"] : [""];
  return runs.flatMap((run, i) => one(run, whose[i]));
}

function one(run, whose) {
  const { verdict } = run;
  if (!verdict) return [badge("none", "?", `No verdict${whose}`, "the result is from an earlier version of the service")];
  const { trusted, because, caveats } = verdict;
  const told = trusted
    ? badge("yes", "✓", `Trusted${whose}`, sentenceOf(run))
    : badge("no", "✗", `Not trusted${whose}`, "the solution fails these checks:");
  return [told, list("reasons", because.map(reason)), list("caveats", caveats.map(({ message }) => [element("span", {}, message)]))];
}

// The sign of the badge is visible only: screen readers get the words, which say the same.
const badge = (trusted, sign, words, hint) =>
  element(
    "p",
    {},
    element("strong", { class: "badge", "data-trusted": trusted }, element("span", { "aria-hidden": "true" }, sign), words),
    element("span", { class: "hint" }, hint),
  );

const reason = ({ code, value, allowed, message }) => [
  element("strong", {}, `${code.replaceAll("_", " ")}: `),
  element("span", { class: "measured" }, measured({ value, allowed })),
  " ",
  element("span", { class: "detail" }, message),
];

const list = (name, items) =>
  items.length === 0 ? null : element("ul", { class: name }, ...items.map((parts) => element("li", {}, ...parts)));
