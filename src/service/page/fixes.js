// Fixes of errors of a specification by one click: the name that was meant replaces the one that was written.

import { rangesOf } from "./places.js";

// Returns the fixes of an error, {name, change: {from, to, insert}}; none if it is not known what to write.
export function fixesOf({ pointer, detail, did_you_mean: meant }, text) {
  if (!meant) return [];
  const written = /`([^`]+)`/.exec(detail)?.[1] ?? pointer.split("/").at(-1).replaceAll("~1", "/").replaceAll("~0", "~");
  const key = keyRange(text, pointer, written);
  const place = key ?? inValue(text, pointer, written);
  return place === null ? [] : [{ name: `Write ${meant}`, change: { from: place[0], to: place[1], insert: meant } }];
}

// Returns the range in the text of the last key of `pointer`, if it is the name that was written by mistake.
function keyRange(text, pointer, written) {
  const key = pointer.split("/").at(-1)?.replaceAll("~1", "/").replaceAll("~0", "~");
  const [value] = rangesOf(text, [pointer]);
  if (key !== written || !value) return null;
  const quoted = JSON.stringify(key);
  const at = text.lastIndexOf(quoted, value[0]);
  return at === -1 ? null : [at + 1, at + quoted.length - 1];
}

// Returns the range in the text of a name, as a whole word, within the value to which `pointer` refers.
function inValue(text, pointer, written) {
  const [value] = rangesOf(text, [pointer]);
  if (!value) return null;
  const word = new RegExp(`(?<![A-Za-z_0-9])${written.replace(/[.*+?^${}()|[\]\\]/g, "\\$&")}(?![A-Za-z_0-9])`);
  const found = word.exec(text.slice(...value));
  return found === null ? null : [value[0] + found.index, value[0] + found.index + written.length];
}
