// The colours of the page by their names in its style. Asked of the document, each would have the styles of all that has just changed computed:
// they are kept until the scheme changes.

const known = new Map();

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => known.clear());

export function colourOf(name) {
  if (!known.has(name)) known.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return known.get(name);
}
