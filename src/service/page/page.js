// The page: what is written is checked, what is submitted is followed, and what has ended is shown.
//
// The job that is shown is named in the address (`#job=ID`), so that it can be kept and sent; the ids of the jobs of
// this browser are kept in its local storage.

import { Editor } from "./editor.js";
import { byId, element } from "./element.js";
import { analysis, evidence } from "./evidence.js";
import { number, seconds } from "./numbers.js";
import { lineAt, linesOf } from "./places.js";
import { Plots } from "./plots.js";
import * as service from "./service.js";
import { study } from "./study.js";
import { verdicts } from "./verdict.js";

const PAUSE = 250; // milliseconds without a keystroke before a check
const PANELS = 6; // fields shown at first
const REMEMBERED = 50; // jobs

const FORMATS = [
  ["JSON", "application/json", "json"],
  ["CSV", "text/csv", "csv"],
  ["SVG", "image/svg+xml", "svg"],
];

const editor = new Editor(byId("text"), byId("lines"));
const plots = new Plots(byId("plots"), byId("hover"));
let shown = null; // the run in view: {id, label, verdict, t, fields, events, diagnostics}
let other = null; // the run it is compared with
let followed = null; // the id of the job whose progress is in view
let leave = null; // leaves it

// ---- writing and checking

let checking = null;

async function checkText() {
  checking?.abort();
  checking = new AbortController();
  const { signal } = checking;
  const { text } = editor;
  if (text.trim() === "") return tellCheck([], []);
  try {
    const summary = await service.check(text, signal);
    if (!signal.aborted) tellCheck([], analysis(summary));
  } catch (refusal) {
    if (!signal.aborted) tellRefusal(refusal, text);
  }
}

function tellRefusal(refusal, text) {
  if (!(refusal instanceof service.Refused)) throw refusal;
  const errors = refusal.problem.errors ?? [];
  if (errors.length === 0) return tellCheck([], [element("p", { class: "bad" }, refusal.message)]);
  const lines = places(errors, text);
  const items = errors.map((error, i) =>
    element(
      "li",
      {},
      element("button", { type: "button", class: "place", click: () => editor.goTo(lines[i]) }, `line ${lines[i] + 1}`),
      element("code", {}, error.pointer || "(the whole document)"),
      element("span", { class: "detail" }, error.detail),
      error.expected ? element("span", { class: "hint" }, `expected ${error.expected}`) : null,
      error.did_you_mean ? element("span", { class: "hint" }, `did you mean ${error.did_you_mean}?`) : null,
    ),
  );
  const count = errors.length === 1 ? "One error" : `${number(errors.length)} errors`;
  tellCheck(
    errors.map((error, i) => [lines[i], error.detail]),
    [element("p", { class: "bad" }, count), element("ul", { class: "errors" }, ...items)],
  );
}

// A text that is no JSON is wrong where its reader stopped, which is later than where the nearest pointer begins.
function places(errors, text) {
  const lines = linesOf(text, errors.map((error) => error.pointer));
  return errors.map((error, i) => {
    const stop = error.code === "syntax" && / at line (\d+) column \d+$/.exec(error.detail);
    return stop ? Math.min(Number(stop[1]) - 1, lineAt(text, text.trimEnd().length)) : lines[i];
  });
}

function tellCheck(marks, parts) {
  editor.mark(marks);
  byId("check").replaceChildren(...parts);
}

// ---- submitting and following

async function solve() {
  const { text } = editor;
  byId("solve").disabled = true;
  try {
    const status = await service.submit(text);
    remember(status);
    watch(status.id);
  } catch (refusal) {
    tellRefusal(refusal, text);
  } finally {
    byId("solve").disabled = false;
  }
}

async function watch(id) {
  tellMessage();
  try {
    await follow(id);
  } catch (refusal) {
    byId("progress").hidden = true;
    tellMessage(refusal.message);
  }
}

async function follow(id) {
  leave?.abort();
  leave = new AbortController();
  followed = id;
  byId("progress").hidden = false;
  setAside(true);
  const status = await service.follow(id, tellProgress, leave.signal);
  if (status === null) return;
  byId("progress").hidden = true;
  await show(status);
}

function tellProgress(status) {
  const place = status.queue_position > 0 ? `${number(status.queue_position)} before it` : "next";
  byId("state").textContent =
    status.status === "accepted"
      ? `waiting, ${place}`
      : `${status.status}, t = ${number(status.time, 4)}, ${number(status.steps)} steps`;
  byId("bar").value = status.progress;
}

// ---- showing what has ended

async function fetchRun(id, label) {
  const { trajectory, diagnostics, status, verdict, error, study } = await service.results(id);
  return { id, label, status, verdict, error, ...trajectory, diagnostics, study };
}

// What is in view is of the run before, while the next is on its way.
function setAside(aside) {
  byId("before").hidden = !aside || byId("chosen").hidden;
  byId("chosen").classList.toggle("before", aside);
}

async function show(status) {
  location.hash = `job=${status.id}`;
  tellMessage(status.message);
  const run = await fetchRun(status.id, status.label).catch((refusal) => tellMessage(refusal.message));
  shown = run ?? null;
  other = null;
  byId("empty").hidden = true;
  byId("chosen").hidden = false;
  setAside(false);
  byId("label").textContent = status.label ?? "Without a label";
  byId("outcome").textContent = run ? `${status.status} in ${seconds(run.diagnostics.wall_seconds ?? 0)}` : status.status;
  byId("outcome").dataset.status = status.status;
  keep(remembered().map((job) => (job.id === status.id ? { ...job, trusted: status.trusted } : job)));
  byId("study").replaceChildren(...(shown?.study ? study(shown.study) : []));
  offerDownloads();
  offerFields();
  offerOthers();
  draw();
}

function tellMessage(message) {
  byId("message").textContent = message ?? "";
  byId("message").hidden = !message;
}

function draw() {
  const runs = [shown, other].filter((run) => run !== null);
  const chosen = [...byId("fields").querySelectorAll("input:checked")].map((input) => input.value);
  byId("verdict").replaceChildren(...verdicts(runs).filter((part) => part !== null));
  plots.show(runs, chosen);
  byId("evidence").replaceChildren(...(runs.length > 0 ? evidence(runs) : []));
  const warnings = runs.flatMap((run) => run.diagnostics.warnings ?? []);
  byId("warnings").hidden = warnings.length === 0;
  byId("warnings").replaceChildren(...warnings.map((warning) => element("li", {}, warning.message)));
}

function offerFields() {
  const names = Object.keys(shown?.fields ?? {});
  const boxes = names.map((name, i) =>
    element("label", {}, element("input", { type: "checkbox", value: name, checked: i < PANELS, change: draw }), name),
  );
  byId("fields").replaceChildren(element("legend", {}, "Fields"), ...boxes);
}

function offerDownloads() {
  const { id } = shown ?? {};
  const buttons = FORMATS.map(([name, type, extension]) =>
    element("button", { type: "button", click: () => save(id, type, extension) }, name),
  );
  byId("downloads").replaceChildren(...(id ? buttons : []));
}

async function save(id, type, extension) {
  try {
    const address = URL.createObjectURL(await service.download(id, type));
    element("a", { href: address, download: `${id}.${extension}` }).click();
    URL.revokeObjectURL(address);
  } catch (refusal) {
    tellMessage(refusal.message);
  }
}

function offerOthers() {
  const others = remembered().filter((job) => job.id !== shown?.id);
  const options = others.map((job) => element("option", { value: job.id }, named(job)));
  byId("other").replaceChildren(element("option", { value: "" }, "nothing"), ...options);
}

async function compare() {
  const id = byId("other").value;
  other = null;
  if (id !== "") {
    try {
      other = await fetchRun(id, remembered().find((job) => job.id === id)?.label);
    } catch (refusal) {
      tellMessage(refusal.message);
    }
  }
  draw();
}

// ---- the jobs of this browser

const named = (job) => `${job.label ?? "Without a label"}, ${new Date(job.created).toLocaleTimeString()}`;

function remembered() {
  try {
    return JSON.parse(localStorage.getItem("jobs")) ?? [];
  } catch {
    return [];
  }
}

function keep(jobs) {
  localStorage.setItem("jobs", JSON.stringify(jobs.slice(0, REMEMBERED)));
  listJobs();
}

function remember({ id, label, created }) {
  keep([{ id, label, created }, ...remembered().filter((job) => job.id !== id)]);
}

function listJobs() {
  const jobs = remembered();
  byId("history").hidden = jobs.length === 0;
  const items = jobs.map((job) =>
    element(
      "li",
      {},
      element("a", { href: `#job=${job.id}` }, named(job)),
      job.trusted === false ? element("span", { class: "bad" }, "not trusted") : null,
      element("button", { type: "button", "aria-label": `Forget ${named(job)}`, click: () => forget(job.id) }, "forget"),
    ),
  );
  byId("jobs").replaceChildren(...items);
}

async function forget(id) {
  keep(remembered().filter((job) => job.id !== id));
  // The service may have forgotten it before.
  await service.forget(id).catch(() => {});
  offerOthers();
}

async function openAddressed() {
  const id = new URLSearchParams(location.hash.slice(1)).get("job");
  if (id && id !== shown?.id && id !== followed) await watch(id);
}

// ---- everything a user can do

async function start() {
  let pause = null;
  byId("text").addEventListener("input", () => {
    clearTimeout(pause);
    pause = setTimeout(checkText, PAUSE);
  });
  byId("text").addEventListener("keydown", (event) => {
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) solve();
  });
  byId("solve").addEventListener("click", solve);
  byId("format").addEventListener("click", () => {
    try {
      editor.text = JSON.stringify(JSON.parse(editor.text), null, 2);
    } catch {
      checkText();
    }
  });
  byId("cancel").addEventListener("click", () => service.cancel(followed).catch((refusal) => tellMessage(refusal.message)));
  byId("other").addEventListener("change", compare);
  byId("example").addEventListener("change", async (event) => {
    if (event.target.value !== "") editor.text = await service.example(event.target.value);
  });
  addEventListener("tokenrequired", () => (byId("access").hidden = false));
  byId("use").addEventListener("click", () => {
    service.useToken(byId("token").value.trim());
    byId("token").value = "";
    byId("access").hidden = true;
    checkText();
    openAddressed();
  });
  addEventListener("hashchange", openAddressed);
  listJobs();
  try {
    for (const { name, title } of await service.examples()) {
      byId("example").append(element("option", { value: name }, title));
    }
  } catch (refusal) {
    tellCheck([], [element("p", { class: "bad" }, refusal.message)]);
  }
  await openAddressed();
}

start();
