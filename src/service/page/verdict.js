// The verdict on an answer, which stands before the rest of it: a badge; what speaks against the answer, each value beside what is
// allowed; and what should be known though it does not.

import { element } from "./element.js";
import { measured, number } from "./numbers.js";

// The verdict on one run, or on two to be compared.
export function verdicts(runs) {
  const whose = runs.length > 1 ? [" (first)", " (second)"] : [""];
  return runs.flatMap((run, i) => one(run, whose[i]));
}

function one({ verdict, diagnostics }, whose) {
  if (!verdict) return [badge("none", "?", `No verdict${whose}`, "the answer is of an earlier version of the service")];
  const { trusted, because, caveats } = verdict;
  const checks = Object.keys(diagnostics?.checks ?? {}).length;
  const made = checks === 1 ? "1 check was made" : `${number(checks)} checks were made`;
  const told = trusted
    ? badge("yes", "✓", `Trusted${whose}`, checks === 0 ? "the end was reached; nothing else was checked" : `${made}, and nothing speaks against the answer`)
    : badge("no", "✗", `Not trusted${whose}`, "these speak against the answer:");
  return [told, list("reasons", because.map(reason)), list("caveats", caveats.map(({ message }) => [element("span", {}, message)]))];
}

// The sign is for the eye alone: the words say the same.
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
