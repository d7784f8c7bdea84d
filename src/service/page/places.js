// The positions in a JSON text to which JSON pointers (RFC 6901) refer.
//
// The text may be invalid: the part before the error still has its positions. The scan keeps the path to its position
// on a stack of its own, and of that path only the part that wanted pointers share: depth costs neither recursion nor
// memory beyond its size.

// Returns the line of the text, counted from 0, on which each of `pointers` (JSON pointers) begins: the key of a
// member, or an element. A pointer to a missing value gets the line of the nearest value around it.
export function linesOf(text, pointers) {
  return found(text, pointers).map((path) => lineAt(text, path.findLast((place) => place.start !== null)?.start ?? 0));
}

// Returns the offsets [from, to) in the text of the values to which the JSON pointers `pointers` refer, null for
// missing values.
export function rangesOf(text, pointers) {
  const paths = found(text, pointers);
  return paths.map((path, i) => {
    const { from, to } = path.at(-1);
    return from === null || to === null || path.length !== pointers[i].split("/").length ? null : [from, to];
  });
}

// Returns the positions in the text of the values on the path of each of the JSON pointers `pointers`.
function found(text, pointers) {
  const root = place();
  const wanted = pointers.map((pointer) => {
    const path = [root];
    for (const key of pointer.split("/").slice(1)) {
      const { children } = path.at(-1);
      const name = key.replaceAll("~1", "/").replaceAll("~0", "~");
      if (!children.has(name)) children.set(name, place());
      path.push(children.get(name));
    }
    return path;
  });
  find(text, root);
  return wanted;
}

export function lineAt(text, offset) {
  let line = 0;
  for (let at = text.indexOf("\n"); at !== -1 && at < offset; at = text.indexOf("\n", at + 1)) line += 1;
  return line;
}

// A position in a JSON text: `start` is the offset of a key or element, `from` and `to` are the offsets of its value.
const place = () => ({ start: null, from: null, to: null, children: new Map() });

// Sets the offsets in the text of `root` and of the positions below it. Of members with the same key the last counts.
function find(text, root) {
  const open = []; // the objects and lists around the current token: {place, index}, with the index for lists only
  let keyed = false; // whether the key of a member has been read, and its value comes next
  let member = null; // the position (see `place`) of the member whose value comes next, if it is wanted
  const token = /"(?:[^"\\]|\\.)*"?|[{}[\],:]|[^\s{}[\],:"]+/gs;
  for (const { 0: found, index: at } of text.matchAll(token)) {
    const inside = open.at(-1);
    const inList = inside?.index !== undefined;
    if (found === ":") continue;
    if (found === ",") {
      if (inList) inside.index += 1;
      keyed = false;
    } else if (found === "}" || found === "]") {
      const closed = open.pop()?.place;
      if (closed) closed.to = at + 1;
      keyed = false;
    } else if (inside && !inList && !keyed) {
      keyed = true;
      member = inside.place?.children.get(unquoted(found)) ?? null;
      if (member) member.start = at;
    } else {
      const value = !inside ? root : inList ? inside.place?.children.get(String(inside.index)) : member;
      if (value && !keyed) value.start = at;
      if (value) [value.from, value.to] = [at, at + found.length];
      if (found === "{") open.push({ place: value });
      if (found === "[") open.push({ place: value, index: 0 });
      if (found === "{" || found === "[") keyed = false;
    }
  }
}

function unquoted(string) {
  try {
    return JSON.parse(string);
  } catch {
    return string;
  }
}
