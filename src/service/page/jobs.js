// The table of the jobs of this token (or of this address, if the service requires no token), with progress, filters
// and buttons to cancel.

import { element } from "./element.js";
import { number } from "./numbers.js";
import * as service from "./service.js";

const AGAIN = 2000; // milliseconds between two updates while jobs run and the table is open

export class Jobs {
  #root;
  #open;
  #fail;
  #filter = "";
  #cursor = null;
  #timer = null;
  #rows = element("tbody");
  #more;
  #told = element("p", { class: "hint", role: "status" });

  // `open(id)` shows a job of the table, `fail(message)` reports an error.
  constructor(root, { open, fail }) {
    [this.#root, this.#open, this.#fail] = [root, open, fail];
    const filter = element(
      "select",
      { id: "filter", change: (event) => this.#filtered(event.target.value) },
      ...["all", "accepted", "running", "successful", "failed", "dismissed"].map((word) => element("option", { value: word === "all" ? "" : word }, word)),
    );
    const head = ["Job", "State", "Progress", "Verdict", "Created", ""].map((name) => element("th", { scope: "col" }, name === "" ? element("span", { class: "sr" }, "Actions") : name));
    this.#more = element("button", { type: "button", hidden: true, click: () => this.#load(true) }, "Earlier jobs");
    root.replaceChildren(
      element("div", { class: "row" }, element("label", { for: "filter" }, "Show"), filter, element("button", { type: "button", click: () => this.#load() }, "Refresh"), this.#told),
      element("div", { class: "wide", tabindex: "0", role: "region", "aria-label": "Jobs" }, element("table", {}, element("thead", {}, element("tr", {}, ...head)), this.#rows)),
      this.#more,
    );
  }

  // Keeps the table of jobs up to date while it is visible.
  show(visible) {
    clearTimeout(this.#timer);
    if (visible) this.#load();
  }

  #filtered(word) {
    this.#filter = word;
    this.#load();
  }

  async #load(further = false) {
    clearTimeout(this.#timer);
    try {
      const { jobs, next } = await service.jobs(this.#filter, further ? this.#cursor : null);
      this.#cursor = next;
      this.#more.hidden = next === null;
      const rows = jobs.map((job) => this.#row(job));
      if (further) this.#rows.append(...rows);
      else this.#rows.replaceChildren(...rows);
      this.#told.textContent = this.#rows.children.length === 0 ? "No jobs." : "";
      const busy = jobs.some(({ status }) => status === "accepted" || status === "running");
      if (busy && !further && this.#root.checkVisibility()) this.#timer = setTimeout(() => this.#load(), AGAIN);
    } catch (refusal) {
      this.#told.textContent = "";
      this.#fail(refusal.message);
    }
  }

  #row(job) {
    const name = job.label ?? "Without a label";
    const going = job.status === "accepted" || job.status === "running";
    const act = (words, action) =>
      element(
        "button",
        {
          type: "button",
          "aria-label": `${words} ${name}`,
          click: () => action(job.id).then(() => this.#load(), (refusal) => this.#fail(refusal.message)),
        },
        words,
      );
    const verdict = job.trusted === true ? element("span", { class: "good" }, "trusted") : job.trusted === false ? element("span", { class: "bad" }, "not trusted") : "–";
    return element(
      "tr",
      {},
      element("td", {}, element("a", { href: `#job=${job.id}`, click: () => this.#open(job.id) }, name)),
      element("td", {}, job.status),
      element("td", {}, going ? element("progress", { max: 100, value: job.progress, "aria-label": `Progress of ${name}` }) : `${number(job.progress)} %`),
      element("td", {}, verdict),
      element("td", {}, new Date(job.created).toLocaleString()),
      element("td", {}, going ? act("Cancel", service.cancel) : act("Delete", service.forget)),
    );
  }
}
