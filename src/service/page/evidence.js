// Tables of what a solve or a check reports beside the trajectory, with one column per run. They contain everything
// that the service reports, under the names that it uses, so that additions to the service are shown too.

import { element } from "./element.js";
import { measured, number, seconds } from "./numbers.js";

const UNIQUENESS = {
  unique: "a solution exists and is unique",
  locally_unique: "a solution exists and is unique up to points at which the equations are not Lipschitz",
  exists_not_certified: "a solution exists; its uniqueness is not certified",
  not_certified: "neither existence nor uniqueness is certified",
  not_unique: "solutions are not unique in general",
  not_analysed: "existence and uniqueness were not analysed",
};

const WORDS = { vi: "variational inequalities", wall_seconds: "wall time" };

const words = (name) => WORDS[name] ?? name.replaceAll("_", " ");

const LONGEST = 200; // largest number of rows of a list

// Returns everything in `diagnostics` of one run, or of two runs to be compared, as elements.
export function evidence(runs) {
  const all = runs.map((run) => run.diagnostics);
  const keys = new Set(all.flatMap((diagnostics) => Object.keys(diagnostics)));
  keys.delete("warnings"); // warnings stand above the plots
  const names = [...keys];
  const isScalar = (name) => all.every((one) => isShort(one[name] ?? 0));
  const isRecord = (name) => all.every((one) => isPlain(one[name] ?? {}));
  const rows = names.filter(isScalar).map((name) => row(name, all.map((one) => one[name])));
  const parts = [table("Summary", rows)];
  for (const name of names.filter((name) => !isScalar(name) && isRecord(name))) {
    const entries = [...new Set(all.flatMap((one) => Object.keys(one[name] ?? {})))];
    const rows = entries.map((key) => row(key, all.map((one) => one[name]?.[key])));
    if (rows.length > 0) parts.push(table(words(name), rows));
  }
  const listed = names.filter((name) => !isScalar(name) && !isRecord(name));
  runs.forEach((run, i) => {
    const whose = runs.length > 1 ? ` of the ${i === 0 ? "first" : "second"}` : "";
    for (const name of listed) parts.push(list(`${words(name)}${whose}`, run.diagnostics[name] ?? []));
    parts.push(list(`events${whose}`, run.events));
  });
  return parts.filter((part) => part !== null);
}

// Returns the result of a check of a specification: the properties that matter most, each in words.
export function analysis(summary) {
  const size = `${count(summary.states, "state")}, ${count(summary.variables, "variable")}`;
  const index = summary.index == null ? "" : `Index ${summary.index}. `;
  const parts = [
    element("p", { class: "good" }, `Correct: ${size}; method ${summary.method}.`),
    element("p", { class: "hint" }, `${index}${sentence(told("uniqueness", summary.uniqueness))} ${sentence(summary.because)}`),
  ];
  for (const warning of summary.warnings ?? []) parts.push(element("p", { class: "warning" }, warning.message ?? warning));
  return parts;
}

const count = (n, word) => `${number(n)} ${word}${n === 1 ? "" : "s"}`;

const sentence = (text) => (text ? `${text[0].toUpperCase()}${text.slice(1)}.` : "");

// Whether a value of the diagnostics is a number, a sentence, or a few numbers, which fit into one cell of a table.
const isShort = (value) =>
  Array.isArray(value) ? value.length <= 8 && value.every((one) => typeof one === "number") : typeof value !== "object";

const isPlain = (value) => value !== null && typeof value === "object" && !Array.isArray(value);

// Returns a row of the table of diagnostics with one cell per run; a long text that all runs share is shown once.
function row(name, values) {
  const texts = values.map((value) => told(name, value));
  const once = texts.length > 1 && texts[0].length > 40 && texts.every((text) => text === texts[0]);
  const cells = once
    ? [element("td", { colspan: texts.length }, texts[0])]
    : texts.map((text, i) => element("td", { class: isBeyond(values[i]) ? "bad" : null }, text));
  return element("tr", {}, element("th", { scope: "row" }, words(name)), ...cells);
}

// Whether a check of the solution has failed: its value exceeds the allowed one.
const isBeyond = (value) => value != null && typeof value === "object" && value.value > value.allowed;

function told(name, value) {
  if (value == null) return "–";
  if (name === "uniqueness") return UNIQUENESS[value] ?? words(value);
  if (name === "wall_seconds") return seconds(value);
  if (typeof value === "number") return number(value);
  if (Array.isArray(value)) return value.map((one) => told("", one)).join(", ") || "none";
  if (typeof value === "object" && "allowed" in value) return measured(value);
  if (typeof value === "object") return Object.entries(value).map(([key, one]) => `${words(key)} ${told(key, one)}`).join(", ") || "none";
  return String(value);
}

function table(title, rows) {
  return element("table", {}, element("caption", {}, title), element("tbody", {}, ...rows));
}

const isEvent = (item) => item !== null && typeof item === "object" && "kind" in item && "of" in item && "t" in item;

const eventText = ({ t, kind, of }) => `t = ${number(t, 9)}: ${words(kind)} of ${of}`;

function list(title, items) {
  if (items.length === 0) return null;
  const shown = items.slice(0, LONGEST).map((item) => element("li", {}, isEvent(item) ? eventText(item) : told("", item)));
  if (items.length > LONGEST) shown.push(element("li", {}, `and ${number(items.length - LONGEST)} more, in the download`));
  return element("details", {}, element("summary", {}, `${title} (${number(items.length)})`), element("ol", { tabindex: "0" }, ...shown));
}
