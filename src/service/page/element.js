// Elements by their id, and new elements from their parts. Text is only ever set as text, never parsed as markup.

export const byId = (id) => document.getElementById(id);

// Creates an element, for example element("a", {href: "/schema", class: "link"}, "schema", element("b", {}, "!")).
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(key, value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value != null) made.setAttribute(key, value);
  }
  made.append(...children.filter((child) => child != null));
  return made;
}
