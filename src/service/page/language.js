// What the JSON Schema says of a place in a specification: the keys that may stand there, the values, and their
// meaning.

// Returns the JSON Schemas that a value may satisfy by `schema`: references are followed, and alternatives listed.
function alternatives(schema, root, depth = 0) {
  if (schema === undefined || schema === null || depth > 12) return [];
  if (schema.$ref) {
    const named = root.$defs?.[schema.$ref.split("/").at(-1)];
    const description = schema.description;
    return alternatives(named, root, depth + 1).map((one) => (description ? { ...one, said: description } : one));
  }
  const several = [...(schema.oneOf ?? []), ...(schema.anyOf ?? [])];
  if (several.length > 0) return several.flatMap((one) => alternatives(one, root, depth + 1));
  return [schema];
}

// Returns those of the alternative schemas that have keys of `value`, or all if none has.
function fitting(all, value) {
  const keys = value !== null && typeof value === "object" && !Array.isArray(value) ? Object.keys(value) : [];
  const known = all.filter((one) => one.properties && keys.some((key) => Object.hasOwn(one.properties, key)));
  return known.length > 0 ? known : all;
}

// Returns the JSON Schemas of the value at `path`, a list of keys and indices, in the document `value`, which may be
// incomplete.
export function schemasAt(root, path, value) {
  let [here, at] = [alternatives(root, root), value];
  for (const key of path) {
    here = fitting(here, at).flatMap((one) => {
      if (typeof key === "number") return alternatives(one.prefixItems?.[key] ?? (one.items || undefined), root);
      return alternatives(one.properties?.[key] ?? (typeof one.additionalProperties === "object" ? one.additionalProperties : undefined), root);
    });
    at = at?.[key];
  }
  return fitting(here, at);
}

// Returns the keys that may stand in the object at `path` of a specification: {key, description, required, sample}.
export function keysAt(root, path, value) {
  const found = new Map();
  for (const schema of schemasAt(root, path, value)) {
    for (const [key, inner] of Object.entries(schema.properties ?? {})) {
      if (!found.has(key)) found.set(key, { key, description: descriptionOf(inner, root), required: schema.required?.includes(key) ?? false, sample: sample(inner, root) });
    }
  }
  return [...found.values()];
}

// Returns the words that the value at `path` of a specification may be.
export function valuesAt(root, path, value) {
  return schemasAt(root, path, value).flatMap((schema) => (schema.enum ?? []).map((word) => ({ word, description: schema.description ?? "" })));
}

// Returns the description of the key at the end of `path` in a specification.
export function meaningOf(root, path, value) {
  const parents = schemasAt(root, path.slice(0, -1), value);
  const key = path.at(-1);
  for (const schema of parents) {
    const inner = schema.properties?.[key];
    if (inner) return descriptionOf(inner, root);
  }
  for (const schema of parents) {
    if (typeof schema.additionalProperties === "object") return descriptionOf(schema.additionalProperties, root);
  }
  return null;
}

function descriptionOf(schema, root) {
  if (schema.description) return schema.description;
  const inner = schema.oneOf?.find((one) => one.description);
  return inner?.description ?? alternatives(schema, root)[0]?.description ?? "";
}

// Returns the text that completion in the editor writes as the value of a key.
function sample(schema, root) {
  const all = alternatives(schema, root);
  const is = (type) => all.some((one) => [one.type].flat().includes(type));
  if (is("object")) return "{}";
  if (is("array")) return "[]";
  const word = all.find((one) => one.enum)?.enum[0];
  if (word !== undefined) return JSON.stringify(word);
  if (is("boolean")) return "true";
  if (is("number") || is("integer")) return "1";
  return '""';
}

const FUNCTIONS = [
  "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "ln", "log10", "sqrt", "cbrt", "abs", "sign",
  "min", "max", "heaviside", "pow", "floor", "ceil", "round", "mod", "if", "pwm", "sawtooth", "triangle", "pulse", "sum",
];

// Returns the names that an expression of a specification may use, with what they stand for.
export function namesOf(value) {
  const names = new Map([["t", "the time"], ["pi", "3.14159..."], ...FUNCTIONS.map((name) => [name, "function"])]);
  const [inner] = Object.values(value?.problem ?? {});
  for (const [section, what] of [
    ["parameters", "parameter"], ["definitions", "definition"], ["states", "state"], ["variables", "variable"], ["coordinates", "coordinate"],
    ["tables", "table"], ["integrals", "integral"],
  ]) {
    for (const name of Object.keys(inner?.[section] ?? {})) {
      names.set(name, what);
      if (section === "coordinates") names.set(`${name}_dot`, "velocity");
    }
  }
  return names;
}

// Whether the value at `path` of a specification may be an expression.
export const takesExpression = (root, path, value) =>
  schemasAt(root, path, value).some((schema) => schema.type === "string" && !schema.enum) && path[0] === "problem";
