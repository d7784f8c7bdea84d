// The editor of a specification: CodeMirror with completion and explanations from the JSON Schema, and with the
// errors that the service reports, at their lines and each with a suggested fix.
//
// The editor lives in a shadow tree, where its styles are sheets of the script and need no exception from the content
// security policy.

import {
  EditorState, EditorView, GutterMarker, HighlightStyle, RangeSet, StateEffect, StateField, autocompletion, bracketMatching, completionKeymap,
  defaultKeymap, gutterLineClass, highlightActiveLine, highlightSpecialChars, history, historyKeymap, hoverTooltip, indentUnit, json, keymap,
  lineNumbers, lintKeymap, placeholder, searchKeymap, setDiagnostics, syntaxHighlighting, syntaxTree, tags,
} from "./vendor/codemirror.js";
import { element } from "./element.js";
import { keysAt, meaningOf, namesOf, takesExpression, valuesAt } from "./language.js";
import { rangesOf } from "./places.js";

const LOOK = EditorView.theme({
  "&": { height: "100%", fontSize: "13.3px", color: "var(--ink)", backgroundColor: "var(--paper)" },
  ".cm-scroller": { fontFamily: 'ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace', lineHeight: "1.5rem" },
  ".cm-content": { caretColor: "var(--ink)" },
  "&.cm-focused": { outline: "none" },
  "&.cm-focused .cm-selectionBackground, .cm-content ::selection": { backgroundColor: "var(--select)" },
  ".cm-gutters": { backgroundColor: "var(--paper)", color: "var(--quiet)", border: "none" },
  ".cm-activeLine, .cm-activeLineGutter": { backgroundColor: "transparent" },
  ".cm-gutterElement.marked": { backgroundColor: "var(--bad-band)", color: "var(--bad)", fontWeight: "700", boxShadow: "inset 3px 0 var(--bad)" },
  ".cm-tooltip": { backgroundColor: "var(--sheet)", color: "var(--ink)", border: "1px solid var(--rule)", borderRadius: "6px", maxWidth: "32rem", fontSize: "13px" },
  ".cm-meaning": { padding: ".4rem .7rem", whiteSpace: "pre-wrap", fontFamily: "system-ui, sans-serif" },
  ".cm-tooltip-autocomplete ul li[aria-selected]": { backgroundColor: "var(--accent)", color: "var(--on-accent)" },
  ".cm-completionDetail": { color: "inherit", opacity: ".8", marginLeft: ".6em" },
  ".cm-completionInfo": { whiteSpace: "pre-wrap", maxWidth: "22rem", fontFamily: "system-ui, sans-serif" },
  // The underline of the CodeMirror library is an image in the URL of a style, which the content security policy
  // refuses.
  ".cm-lintRange, .cm-lintRange-error, .cm-lintRange-active": { backgroundImage: "none", textDecoration: "underline wavy var(--bad) 1px" },
  ".cm-diagnostic": { fontFamily: "system-ui, sans-serif", whiteSpace: "pre-wrap" },
  ".cm-diagnosticAction": { backgroundColor: "var(--accent)", color: "var(--on-accent)", borderRadius: "4px" },
  ".cm-panels": { backgroundColor: "var(--sheet)", color: "var(--ink)" },
  ".cm-placeholder": { color: "var(--quiet)" },
  ".cm-matchingBracket": { backgroundColor: "var(--select)" },
});

const COLOURS = HighlightStyle.define([
  { tag: tags.propertyName, color: "var(--accent)" },
  { tag: tags.string, color: "var(--string)" },
  { tag: tags.number, color: "var(--number)" },
  { tag: [tags.bool, tags.null], color: "var(--warn)" },
]);

const PAUSE = 200; // milliseconds after the last number from a slider until the view shows it

const setMarks = StateEffect.define();
const marker = new (class extends GutterMarker {
  elementClass = "marked";
})();

// The marks of errors in the gutter of the editor, at their lines.
const marks = StateField.define({
  create: () => RangeSet.empty,
  update(set, transaction) {
    const { doc } = transaction.state;
    for (const effect of transaction.effects) {
      if (!effect.is(setMarks)) continue;
      const lines = [...new Set(effect.value)].filter((line) => line < doc.lines).sort((a, b) => a - b);
      return RangeSet.of(lines.map((line) => marker.range(doc.line(line + 1).from)));
    }
    return set.map(transaction.changes);
  },
  provide: (field) => gutterLineClass.from(field),
});

export class Editor {
  #view;
  #schema = null;
  #fetch; // the function that fetches the schema
  #asked = null;
  #marked = 0; // number of errors that are marked
  #written = null; // the text that a slider wrote and the view does not show yet
  #later = null;
  #follows = false; // whether the view is being updated to the text that a slider wrote

  // `changed()` is called when the text has changed, `submit()` on Ctrl+Enter; `schema()` fetches the JSON Schema for
  // completion and explanations, when the editor is first used.
  constructor(host, { changed, submit, schema }) {
    this.#fetch = schema;
    host.addEventListener("focusin", () => {
      this.#follow();
      this.#known();
    });
    const shadow = host.attachShadow({ mode: "open" });
    const solve = () => (submit(), true);
    this.#view = new EditorView({
      parent: shadow,
      root: shadow,
      state: EditorState.create({
        doc: "",
        extensions: [
          keymap.of([{ key: "Mod-Enter", run: solve }]),
          lineNumbers(), highlightSpecialChars(), highlightActiveLine(), history(), bracketMatching(), indentUnit.of("  "),
          json(), syntaxHighlighting(COLOURS), LOOK, marks,
          placeholder("Pick an example, or paste a specification."),
          autocompletion({ override: [(context) => (this.#schema ? this.#complete(context) : this.#known().then((schema) => (schema && !context.aborted ? this.#complete(context) : null)))], activateOnTyping: true }),
          hoverTooltip(async (view, at) => ((await this.#known()) ? this.#meaning(view, at) : null)),
          keymap.of([...completionKeymap, ...lintKeymap, ...searchKeymap, ...historyKeymap, ...defaultKeymap]),
          EditorView.contentAttributes.of({ "aria-label": "Specification, JSON", spellcheck: "false", autocapitalize: "off", tabindex: "0" }),
          EditorView.updateListener.of((update) => {
            if (!update.docChanged || this.#follows) return;
            this.#written = null; // the text that the reader writes is newer
            changed();
          }),
        ],
      }),
    });
  }

  // Returns the JSON Schema of a specification; null as long as the service does not return it.
  async #known() {
    this.#asked ??= this.#fetch().catch(() => (this.#asked = null));
    return (this.#schema ??= await this.#asked);
  }

  get text() {
    return this.#written ?? this.#view.state.doc.toString();
  }

  set text(text) {
    this.#follow();
    const { state } = this.#view;
    this.#view.dispatch({ changes: { from: 0, to: state.doc.length, insert: text }, selection: { anchor: 0 } });
    this.#view.scrollDOM.scrollTop = 0;
  }

  // Replaces the value at `pointer` in the text; does nothing if there is no such value. A slider does so many times
  // a second, and each change of the view costs a layout of the page: the view is updated when the slider rests, or
  // at once when it is released; `changed` is not called.
  write(pointer, value, done) {
    const { text } = this;
    const [range] = rangesOf(text, [pointer]);
    if (!range) return;
    this.#written = text.slice(0, range[0]) + JSON.stringify(value) + text.slice(range[1]);
    if (done) this.#follow();
    else {
      clearTimeout(this.#later);
      this.#later = setTimeout(() => this.#follow(), PAUSE);
    }
  }

  // Updates the editor to the text that a slider wrote, by one change of the part that differs.
  #follow() {
    clearTimeout(this.#later);
    this.#later = null;
    if (this.#written === null) return;
    const [before, after] = [this.#view.state.doc.toString(), this.#written];
    this.#written = null;
    if (before === after) return;
    let from = 0;
    while (from < Math.min(before.length, after.length) && before[from] === after[from]) from += 1;
    let end = 0;
    while (end < Math.min(before.length, after.length) - from && before.at(-1 - end) === after.at(-1 - end)) end += 1;
    this.#follows = true;
    this.#view.dispatch({ changes: { from, to: before.length - end, insert: after.slice(from, after.length - end) }, userEvent: "input.type" });
    this.#follows = false;
  }

  // Marks errors of the specification in the editor: {line, from, to, message, fixes: [{name, apply(text) -> [from, to,
  // insert]}]}.
  mark(errors) {
    if (errors.length === 0 && this.#marked === 0) return;
    this.#marked = errors.length;
    this.#follow();
    const { state } = this.#view;
    const { length, lines } = state.doc;
    const diagnostics = errors.map(({ line, from, to, message, fixes }) => {
      const row = state.doc.line(Math.min(line, lines - 1) + 1);
      return {
        from: Math.min(from ?? row.from, length),
        to: Math.min(to ?? row.to, length),
        severity: "error",
        message,
        actions: fixes.map(({ name, change }) => ({
          name,
          apply: (view) => view.dispatch({ changes: change }),
        })),
      };
    });
    this.#view.dispatch(setDiagnostics(state, diagnostics));
    this.#view.dispatch({ effects: setMarks.of(errors.map(({ line }) => line)) });
    this.#view.contentDOM.setAttribute("aria-invalid", errors.length > 0);
  }

  change(change) {
    this.#follow();
    this.#view.dispatch({ changes: change });
    this.#view.focus();
  }

  focus() {
    this.#view.focus();
  }

  // Puts the cursor on a line of the editor, counted from 0, and scrolls to it.
  goTo(line) {
    this.#follow();
    const { doc } = this.#view.state;
    const { from, to } = doc.line(Math.min(line + 1, doc.lines));
    this.#view.focus();
    this.#view.dispatch({ selection: { anchor: from, head: to }, effects: EditorView.scrollIntoView(from, { y: "center" }) });
  }

  #complete(context) {
    const node = syntaxTree(context.state).resolveInner(context.pos, -1);
    const text = context.state.doc.toString();
    const value = lenient(text);
    const path = pathAt(context.state, node);
    const inString = node.name === "String" || node.name === "PropertyName";
    if (node.name === "PropertyName" || (node.name === "Object" && expectsKey(context.state, node, context.pos))) {
      const parent = node.name === "PropertyName" ? path.slice(0, -1) : path;
      if (!inString && !context.explicit) return null;
      const after = /^\s*:/.test(text.slice(inString ? node.to : context.pos));
      // If the cursor is within quotes, completion replaces them together with the key.
      const apply = (written) => (view, completion, from, to) => {
        const [start, end] = inString ? [from - 1, to + (view.state.sliceDoc(to, to + 1) === '"' ? 1 : 0)] : [from, to];
        view.dispatch({ changes: { from: start, to: end, insert: written }, selection: { anchor: start + written.length }, userEvent: "input.complete" });
      };
      const options = keysAt(this.#schema, parent, value).map(({ key, description, required, sample }) => ({
        label: key,
        detail: required ? "required" : undefined,
        info: description,
        boost: required ? 1 : 0,
        apply: apply(after ? `"${key}"` : `"${key}": ${sample}`),
      }));
      return { from: inString ? node.from + 1 : context.pos, options, validFor: /^\w*$/ };
    }
    const words = valuesAt(this.#schema, path, value).map(({ word, description }) => ({ label: JSON.stringify(word), info: description, type: "enum" }));
    if (words.length > 0 && (inString || context.explicit)) {
      return { from: inString ? node.from : context.pos, to: inString ? node.to : undefined, options: words };
    }
    if (node.name === "String" && takesExpression(this.#schema, path, value)) {
      const word = context.matchBefore(/[A-Za-z_][A-Za-z_0-9]*/);
      if (!word) return null;
      const options = [...namesOf(value)].map(([label, detail]) => ({ label, detail, type: detail === "function" ? "function" : "variable" }));
      return { from: word.from, options };
    }
    return null;
  }

  #meaning(view, at) {
    const node = syntaxTree(view.state).resolveInner(at, 1);
    if (node.name !== "PropertyName") return null;
    const path = pathAt(view.state, node);
    const meaning = meaningOf(this.#schema, path, lenient(view.state.doc.toString()));
    if (!meaning) return null;
    const create = () => ({ dom: element("div", { class: "cm-meaning" }, element("b", {}, `${path.at(-1)}  `), meaning) });
    return { pos: node.from, end: node.to, above: true, create };
  }
}

// Returns the keys and indices that lead from the root of the document to a node of its syntax tree.
function pathAt(state, node) {
  const path = [];
  for (let at = node; at !== null; at = at.parent) {
    if (at.name === "Property") {
      const name = at.getChild("PropertyName");
      if (name) path.unshift(unquoted(state.sliceDoc(name.from, name.to)));
    } else if (at.parent?.name === "Array" && !["[", "]", ","].includes(at.name)) {
      let index = 0;
      for (let child = at.parent.firstChild; child && child.from < at.from; child = child.nextSibling) if (!/^[[\],⚠]$/.test(child.name)) index += 1;
      path.unshift(index);
    }
  }
  return path;
}

const unquoted = (string) => string.replace(/^"|"$/g, "");

// Whether the next token in an object of the document is a key: only white space follows `{` or `,`.
function expectsKey(state, node, pos) {
  return /[{,]\s*$/.test(state.sliceDoc(Math.max(node.from, pos - 200), pos));
}

// Parses a JSON text as far as possible: it is cut where it becomes invalid, and open objects and lists are closed.
export function lenient(text) {
  try {
    return JSON.parse(text);
  } catch {
    const root = {};
    const stack = [{ into: root, key: "root" }];
    for (const { 0: token } of text.matchAll(/"(?:[^"\\\n]|\\.)*"?|[{}[\],:]|[^\s{}[\],:"]+/g)) {
      const top = stack.at(-1);
      if (top === undefined) break;
      const put = (value) => {
        if (Array.isArray(top.into)) top.into.push(value);
        else if (top.key !== null) [top.into[top.key], top.key] = [value, null];
      };
      if (token === "{" || token === "[") {
        const made = token === "{" ? {} : [];
        put(made);
        stack.push({ into: made, key: null });
      } else if (token === "}" || token === "]") stack.pop();
      else if (token === ":" || token === ",") continue;
      else if (!Array.isArray(top.into) && top.key === null) top.key = unquoted(token);
      else put(token.startsWith('"') ? unquoted(token) : Number(token));
    }
    return root.root ?? null;
  }
}
