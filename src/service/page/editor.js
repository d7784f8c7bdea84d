// The text of a specification, with its lines numbered and those that are wrong marked.
//
// Numbers and marks stand in a list behind the text, which is transparent; only the lines in view are made, so that a
// specification of a hundred thousand lines scrolls like a short one.

import { element } from "./element.js";

export class Editor {
  #text;
  #lines;
  #marks = new Map();

  constructor(text, lines) {
    this.#text = text;
    this.#lines = lines;
    for (const event of ["input", "scroll"]) text.addEventListener(event, () => this.#draw());
    new ResizeObserver(() => this.#draw()).observe(text);
  }

  get text() {
    return this.#text.value;
  }

  set text(text) {
    this.#text.value = text;
    this.#text.scrollTop = 0;
    this.#text.dispatchEvent(new Event("input"));
  }

  // Marks lines, counted from 0, each with what is to be said of it.
  mark(marks) {
    this.#marks = new Map(marks);
    this.#text.setAttribute("aria-invalid", this.#marks.size > 0);
    this.#draw();
  }

  // Puts the cursor on a line and shows it.
  goTo(line) {
    const lines = this.text.split("\n");
    const start = lines.slice(0, line).join("\n").length + (line > 0 ? 1 : 0);
    this.#text.focus();
    this.#text.setSelectionRange(start, start + (lines[line]?.length ?? 0));
    this.#text.scrollTop = Math.max(0, (line - 3) * this.#lineHeight);
  }

  get #lineHeight() {
    return parseFloat(getComputedStyle(this.#text).lineHeight);
  }

  #draw() {
    const { scrollTop, clientHeight, value } = this.#text;
    const height = this.#lineHeight;
    const first = Math.floor(scrollTop / height);
    const count = value.split("\n").length;
    const last = Math.min(count, first + Math.ceil(clientHeight / height) + 1);
    const numbers = [];
    for (let line = first; line < last; line += 1) {
      const mark = this.#marks.get(line);
      numbers.push(element("li", { class: mark ? "marked" : null, title: mark }, String(line + 1)));
    }
    this.#lines.replaceChildren(...numbers);
    this.#lines.style.transform = `translateY(${first * height - scrollTop}px)`;
  }
}
