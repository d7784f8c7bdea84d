// The colours of the page by their names in its style. Reading a colour from the document would compute the styles of
// all that has changed, so that colours are kept until the colour scheme changes.

const known = new Map();

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => known.clear());

export function colourOf(name) {
  if (!known.has(name)) known.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return known.get(name);
}
