// The parts of an answer of which this page has no picture, such as tables of a later kind: they are shown as tables
// or JSON.

import { element } from "./element.js";
import { number } from "./numbers.js";

const KNOWN = new Set([
  "version", "status", "verdict", "error", "trajectory", "diagnostics", "study", "t", "fields", "events", "id", "label", "text", "specification",
]);
// Parts of an answer that are folded: they matter when results are passed on, not when they are viewed.
const FOLDED = new Set(["provenance"]);
const ROWS = 200;

export function unknownParts(run) {
  const moment = run.t?.length === 1 ? { values: Object.fromEntries(Object.entries(run.fields ?? {}).map(([name, [value]]) => [name, value])) } : {};
  return Object.entries({ ...run, ...moment })
    .filter(([key, value]) => !KNOWN.has(key) && value !== null && value !== undefined)
    .map(([key, value]) => {
      const shown = tableOf(value) ?? element("pre", {}, JSON.stringify(value, null, 2).slice(0, 20000));
      return element("details", FOLDED.has(key) ? { class: "part" } : { open: true, class: "part" }, element("summary", {}, key.replaceAll("_", " ")), element("div", { class: "wide", tabindex: "0", role: "region", "aria-label": key.replaceAll("_", " ") }, shown));
    });
}

const told = (value) => {
  if (typeof value === "number") return number(value);
  if (value === null) return "–";
  if (typeof value !== "object") return String(value);
  if (Array.isArray(value)) return JSON.stringify(value);
  return Object.entries(value).map(([name, one]) => (isObject(one) ? `${name}: ${told(one)}` : `${name} ${told(one)}`)).join(", ");
};

const isObject = (value) => value !== null && typeof value === "object" && !Array.isArray(value);

// Returns a table of a part of an answer: a list of similar objects, columns of equal length, or names with short
// values; null for others.
function tableOf(value) {
  if (Array.isArray(value) && value.length > 0 && value.every((row) => row !== null && typeof row === "object" && !Array.isArray(row))) {
    const columns = [...new Set(value.flatMap((row) => Object.keys(row)))];
    return rows(columns, value.slice(0, ROWS).map((row) => columns.map((name) => row[name] ?? null)), value.length);
  }
  if (Array.isArray(value) || typeof value !== "object") return null;
  if (value.columns !== null && typeof value.columns === "object" && !Array.isArray(value.columns)) return tableOf(value.columns);
  const entries = Object.entries(value);
  const lists = entries.filter(([, one]) => Array.isArray(one));
  if (lists.length === entries.length && lists.length > 0 && lists.every(([, one]) => one.length === lists[0][1].length)) {
    const { length } = lists[0][1];
    return rows(lists.map(([name]) => name), Array.from({ length: Math.min(length, ROWS) }, (_, i) => lists.map(([, one]) => one[i])), length);
  }
  return rows(["", "value"], entries.map(([name, one]) => [name.replaceAll("_", " "), one]), entries.length);
}

function rows(columns, list, all) {
  const body = list.map((row) => element("tr", {}, ...row.map((value) => element("td", {}, told(value)))));
  const left = all > list.length ? [element("tr", {}, element("td", { colspan: columns.length }, `and ${number(all - list.length)} more, in the download`))] : [];
  const head = columns.map((name) => (name === "" ? element("td") : element("th", { scope: "col" }, name)));
  return element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...body, ...left));
}
