// The script of the page: a specification is checked as it is written, and solved at once as long as that is quick; a
// submitted job is followed, and its answer is shown when it has ended.
//
// An answer belongs to the text of the specification that was solved. If the editor has another text, the answer is
// marked as old, until there is a new one. The URL contains the job that is shown (`#job=ID`) or the whole
// specification (`#s=...`).

import { Clock } from "./clock.js";
import { claims } from "./claims.js";
import { Editor, lenient } from "./editor.js";
import { byId, element } from "./element.js";
import { analysis, evidence } from "./evidence.js";
import { describe, wantsLogTime } from "./fields.js";
import { panelsFigure, phaseFigure, png, textOf } from "./figure.js";
import { fixesOf } from "./fixes.js";
import { gallery } from "./gallery.js";
import { Jobs } from "./jobs.js";
import { Knobs, nameInSweep } from "./knobs.js";
import { Live } from "./live.js";
import { canRecord, record } from "./movie.js";
import { number, seconds } from "./numbers.js";
import { lineAt, linesOf, rangesOf } from "./places.js";
import { Plots, nearestTo } from "./plots.js";
import { Previews } from "./previews.js";
import * as service from "./service.js";
import { isSmall, packed, unpacked } from "./share.js";
import { Stage } from "./stage.js";
import { study } from "./study.js";
import { unknownParts } from "./unknown.js";
import { verdicts } from "./verdict.js";

const PAUSE = 250; // milliseconds without a keystroke before the text is checked
const PANELS = 6; // number of fields that are shown at first
const REMEMBERED = 50; // number of jobs whose ids the browser remembers
const RESTS = 120; // milliseconds after a slider's last answer until texts and tables are updated to it
const SEEN = 150; // milliseconds that a slider's answer may take before the answer in view is marked as old

const FORMATS = [
  ["JSON", "application/json", "json"],
  ["CSV", "text/csv", "csv"],
  ["Arrow", "application/vnd.apache.arrow.stream", "arrows"],
  ["SVG", "image/svg+xml", "svg"],
];

const GUIDE = `${service.base}/docs/evidence`;

const clock = new Clock(byId("clock"));
const plots = new Plots(byId("plots"), byId("hover"));
const stage = new Stage(byId("picture"), byId("stage"), byId("stagehint"), clock);
const editor = new Editor(byId("text"), { changed: textChanged, submit: solve, schema: service.schema });
const knobs = new Knobs(byId("knobs"), turn);
const live = new Live({ answer: showLive, slow: tellSlow, refused: tellRefusal, busy: tellBusy });
const jobs = new Jobs(byId("jobtable"), { open: () => toggleJobs(false), fail: tellMessage });

let map = null; // the heat map, fetched when it is first opened
let shown = null; // the run in view: {id, text, specification, label, verdict, t, fields, events, diagnostics}
let ghost = null; // the run that was in view before a slider moved, drawn behind the current one
let other = null; // the run with which the run in view is compared
let followed = null; // the id of the job whose progress is in view
let leave = null; // the controller that stops the stream of events of the job whose progress is in view
let quick = true; // whether the last live answer came in time
let dragging = false; // whether a slider is held
let filling = false; // whether the page itself changes the text
let behind = null; // the run whose curves are in view, while the texts and tables are those of an earlier run
let resting = null; // the timer after which texts and tables are updated to the curves
let marking = null; // the timer after which the answer in view is marked as old
let awaited = null; // the text of the example whose answer is to be scrolled into view

// ---- editing and checking the specification

let checking = null;
let pause = null;

function textChanged() {
  if (filling) return;
  dragging = false;
  ghost = null; // the ghost, the curves of an earlier run, belongs to a text that a slider has changed, not to this one
  byId("shared").textContent = "";
  markStale();
  clearTimeout(pause);
  pause = setTimeout(textRested, PAUSE);
}

function textRested() {
  checkText({ solves: byId("live").checked && quick && followed === null });
}

// Checks the specification in the editor, and solves it if `solves` is set and the specification is correct.
async function checkText({ solves = false } = {}) {
  checking?.abort();
  checking = new AbortController();
  const { signal } = checking;
  const { text } = editor;
  if (text.trim() === "") return tellCheck([], []);
  offerKnobs(text);
  try {
    const summary = await service.check(text, signal);
    if (signal.aborted) return;
    tellCheck([], analysis(summary));
    if (!solves || text === shown?.text) return;
    if (isSmall(text)) live.solve(text);
    else markStale("Press Solve: this is not run by itself. What stands below is of an earlier text.", "Press Solve: this is not run by itself.");
  } catch (refusal) {
    if (!signal.aborted) tellRefusal(refusal, text);
  }
}

function offerKnobs(text) {
  const specification = lenient(text);
  knobs.show(specification);
  byId("sliders").hidden = knobs.count === 0;
  offerMap();
}

// Offers a heat map over two numbers of the specification, of one of the fields of the answer in view.
function offerMap() {
  const fields = Object.keys(shown?.fields ?? {});
  const specification = lenient(editor.text);
  const known = specification ? knobs.list.filter((knob) => knob.low < knob.high && nameInSweep(knob, specification) !== null) : [];
  byId("mapbox").hidden = known.length < 2 || fields.length === 0;
  map?.offer(known, fields);
}

async function openMap() {
  if (!byId("mapbox").open || map !== null) return;
  const { HeatMap } = await import("./heatmap.js");
  map ??= new HeatMap(byId("map"), { knobs: () => knobs.list, specification: () => lenient(editor.text), open: openCell });
  offerMap();
}

function tellRefusal(refusal, text) {
  if (!(refusal instanceof service.Refused)) throw refusal;
  rest();
  const errors = refusal.problem.errors ?? [];
  if (errors.length === 0) return tellCheck([], [element("p", { class: "bad" }, refusal.message)]);
  const lines = places(errors, text);
  const ranges = rangesOf(text, errors.map((error) => error.pointer));
  const fixes = errors.map((error) => fixesOf(error, text));
  const items = errors.map((error, i) =>
    element(
      "li",
      {},
      element("button", { type: "button", class: "place", click: () => editor.goTo(lines[i]) }, `line ${lines[i] + 1}`),
      element("code", {}, error.pointer || "(the whole document)"),
      element("span", { class: "detail" }, error.detail),
      error.expected ? element("span", { class: "hint" }, `expected ${error.expected}`) : null,
      error.did_you_mean ? element("span", { class: "hint" }, `did you mean ${error.did_you_mean}?`) : null,
      ...fixes[i].map(({ name, change }) => element("button", { type: "button", class: "fix", click: () => editor.change(change) }, name)),
      element("a", { class: "hint", href: `${service.base}/docs/codes#${error.code}` }, error.code),
    ),
  );
  const count = errors.length === 1 ? "One error" : `${number(errors.length)} errors`;
  tellCheck(
    errors.map((error, i) => ({
      line: lines[i],
      from: error.code === "syntax" ? null : ranges[i]?.[0],
      to: error.code === "syntax" ? null : ranges[i]?.[1],
      message: [error.detail, error.expected && `expected ${error.expected}`].filter(Boolean).join("\n"),
      fixes: fixes[i],
    })),
    [element("p", { class: "bad" }, count), element("ul", { class: "errors", tabindex: "0" }, ...items)],
  );
}

// Returns the lines of errors of the specification. A text that is not JSON is wrong where its parser stopped, which is
// later than where the value at the nearest pointer begins.
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
  if (marks.length > 0) markStale("The text has errors: what stands below is of an earlier text.");
}

function fill(text) {
  filling = true;
  editor.text = text;
  filling = false;
}

// ---- sliders of numbers of the specification

function turn(pointer, value, done) {
  if (!dragging) ghost = shown;
  dragging = !done;
  editor.write(pointer, value, done);
  const { text } = editor;
  if (text === shown?.text) return;
  // If the answer comes at once, a mark of the old answer would flicker, so that the mark is delayed.
  marking ??= setTimeout(markStale, SEEN);
  if (byId("live").checked && followed === null) live.solve(text);
  if (done) {
    offerKnobs(text);
    clearTimeout(pause);
    pause = setTimeout(() => checkText({ solves: false }), PAUSE);
  }
}

// Opens the run of a cell of the heat map: writes both of its numbers into the text, and shows the solution.
function openCell(pairs) {
  pairs.forEach(([knob, value], i) => {
    const [pointer, written] = knob.put?.(value) ?? [knob.pointer, value];
    turn(pointer, written, i === pairs.length - 1);
  });
}

// Shows the answer of a live solve. While a slider is dragged, only the curves in view follow every answer, and the
// picture follows some of them; everything else is updated when the slider rests, or when the verdict changes.
function showLive(answer, text) {
  quick = true;
  const specification = lenient(text);
  const run = runOf(answer, { text, specification, label: specification?.label, id: null });
  const follows = dragging && other === null && run.t.length > 1 && hasFieldsOf(run) && isTrusted(run) === isTrusted(shown);
  if (!follows) return presentLive(run);
  byId("chosen").classList.add("behind");
  [shown, behind] = [run, run];
  unmark();
  if (text !== editor.text) marking = setTimeout(markStale, SEEN);
  clock.set(run);
  drawCurves({ hurried: true });
  stage.follow(run);
}

function presentLive(run) {
  present(run, { keep: ghost !== null });
  tellLive(run, run.text);
}

// Shows whether a request for a live solve is pending. A slider counts as resting when a short time has passed without
// requests.
function tellBusy(is) {
  byId("result").setAttribute("aria-busy", is);
  clearTimeout(resting);
  if (!is) resting = setTimeout(rest, RESTS);
}

// Updates texts and tables to the run whose curves are in view.
function rest() {
  if (behind !== null && behind === shown && followed === null) presentLive(behind);
}

const isTrusted = ({ status, verdict }) => status === "completed" && verdict?.trusted === true;

function tellLive(run, text) {
  if (text === awaited) bringResult();
  awaited = null;
  byId("outcome").dataset.status = run.status === "completed" ? "successful" : "failed";
  byId("outcome").textContent = took(run.status === "completed" ? "successful" : run.status.replaceAll("_", " "), run);
  tellMessage(run.error?.message ?? run.error?.detail);
  if (editor.text === text) {
    markStale();
    tellCheck([], byId("check").querySelector(".bad") ? [element("p", { class: "good" }, "Correct.")] : [...byId("check").children]);
  }
}

function tellSlow(text) {
  rest();
  quick = false;
  if (editor.text === text) markStale("This takes longer than a moment: press Solve. What stands below is of an earlier text.", "This takes longer than a moment: press Solve.");
}

// Marks the answer in view as old, if it is not that of the text in the editor.
function markStale(words = "What stands below is of an earlier text.", alone = null) {
  const stale = shown !== null && shown.text !== null && shown.text !== editor.text;
  const running = followed !== null;
  const told = stale ? words : shown === null && alone !== null ? alone : null;
  clearTimeout(marking);
  marking = null;
  if (running) return;
  byId("before").hidden = told === null;
  byId("before").textContent = told ?? "";
  byId("chosen").classList.toggle("stale", stale);
}

// Removes the mark of an old answer: the answer in view is that of the text in the editor, or of its text a moment
// ago.
function unmark() {
  clearTimeout(marking);
  marking = null;
  byId("before").hidden = true;
  byId("chosen").classList.remove("stale");
}

// ---- submitting a job and following its progress

async function solve() {
  const { text } = editor;
  clearTimeout(pause);
  live.stop();
  byId("solve").disabled = true;
  try {
    const status = await service.submit(text);
    remember(status);
    ghost = null;
    watch(status.id, text);
    bringResult();
  } catch (refusal) {
    tellRefusal(refusal, text);
  } finally {
    byId("solve").disabled = false;
  }
}

// Scrolls to the result if it is below the text, as on a narrow screen: the layout may shift when the answer comes.
function bringResult() {
  if (matchMedia("(max-width: 60rem)").matches) byId("result").scrollIntoView();
}

async function watch(id, text = null) {
  tellMessage();
  try {
    await follow(id, text);
  } catch (refusal) {
    if (followed === id) followed = null;
    byId("progress").hidden = true;
    tellMessage(refusal.message);
    setAside(false);
  }
}

async function follow(id, text) {
  leave?.abort();
  leave = new AbortController();
  followed = id;
  byId("progress").hidden = false;
  setAside(true);
  const status = await service.follow(id, tellProgress, leave.signal);
  if (status === null) return;
  byId("progress").hidden = true;
  const known = text ?? (await service.specification(id).catch(() => null));
  if (followed === id) followed = null;
  if (text === null && known !== null) fill(pretty(known));
  await show(status, text === null && known !== null ? pretty(known) : known);
}

// Breaks a specification on one long line into formatted lines; a text with line breaks stays unchanged.
function pretty(text) {
  if (text.includes("\n") || text.length < 120) return text;
  try {
    return JSON.stringify(JSON.parse(text), null, 2);
  } catch {
    return text;
  }
}

function tellProgress(status) {
  const place = status.queue_position > 0 ? `${number(status.queue_position)} before it` : "next";
  byId("state").textContent =
    status.status === "accepted"
      ? `waiting, ${place}`
      : `${status.status}, t = ${number(status.time, 4)}, ${number(status.steps)} steps`;
  byId("bar").value = status.progress;
}

// ---- showing the answer of a job that has ended

const runOf = ({ trajectory, diagnostics = {}, ...rest }, more) => ({ t: [], fields: {}, events: [], ...trajectory, diagnostics, ...rest, ...more });

const fetchRun = async (id, label, text) => runOf(await service.results(id), { id, label, text, specification: text === null ? {} : (lenient(text) ?? {}) });

// Says how a run ended, and how long it took if it was one run: the members of a sweep each have their own time.
const took = (word, { diagnostics: { wall_seconds: wall } }) => (wall > 0 ? `${word} in ${seconds(wall)}` : word);

// Marks the answer in view as that of the previous run, while the answer to the next is awaited.
function setAside(aside) {
  byId("before").hidden = !aside || byId("chosen").hidden;
  byId("before").textContent = aside ? "What stands below is of the run before." : "";
  byId("chosen").classList.toggle("before", aside);
}

async function show(status, text) {
  history.replaceState(null, "", `#job=${status.id}`);
  tellMessage(status.message);
  const run = await fetchRun(status.id, status.label, text).catch((refusal) => tellMessage(refusal.message));
  keep(remembered().map((job) => (job.id === status.id ? { ...job, trusted: status.trusted } : job)));
  setAside(false);
  if (run) present(run);
  else presentNothing(status);
  byId("outcome").textContent = run ? took(status.status, run) : status.status;
  byId("outcome").dataset.status = status.status;
  checkText();
}

// Clears the answer in view, which is that of another problem.
function forgetShown() {
  shown = null;
  [other, ghost] = [null, null];
  clock.reset();
  byId("chosen").hidden = true;
  byId("empty").hidden = true;
  stage.clear();
}

// Shows the status of a job that has no answer, and nothing of another run.
function presentNothing(status) {
  shown = null;
  [other, ghost] = [null, null];
  byId("empty").hidden = true;
  byId("chosen").hidden = false;
  byId("label").textContent = status.label ?? "Without a label";
  byId("chosen").classList.remove("behind");
  for (const id of ["verdict", "study", "unknown", "folded", "downloads", "evidence", "claims", "phase"]) byId(id).replaceChildren();
  if (status.verdict) byId("verdict").replaceChildren(...verdicts([{ verdict: status.verdict, diagnostics: {} }]).filter(Boolean));
  byId("fields").replaceChildren(element("legend", {}, "Fields"));
  for (const id of ["warnings", "picture", "clock", "plotbar", "phasebox", "raw"]) byId(id).hidden = true;
  stage.clear();
  plots.show([], []);
  byId("hover").textContent = "";
}

// Whether a run has the fields of the run in view.
const hasFieldsOf = (run) => shown !== null && shown.t.length > 0 && Object.keys(shown.fields).join() === Object.keys(run.fields).join();

function present(run, { keep: keeps = false } = {}) {
  const sameFields = hasFieldsOf(run);
  shown = run;
  [other, behind] = [null, null];
  byId("chosen").classList.remove("behind");
  byId("empty").hidden = true;
  byId("chosen").hidden = false;
  byId("browse").hidden = false;
  setAside(false);
  markStale();
  byId("label").textContent = run.label ?? "Without a label";
  byId("study").replaceChildren(...(run.study ? study(run.study) : []));
  const parts = unknownParts(run);
  byId("unknown").replaceChildren(...parts.filter(({ open }) => open));
  byId("folded").replaceChildren(...parts.filter(({ open }) => !open));
  for (const id of ["plotbar", "phasebox"]) byId(id).hidden = run.t.length < 2;
  byId("raw").hidden = false;
  offerDownloads();
  if (!sameFields) {
    ghost = keeps ? ghost : null;
    offerFields();
    byId("logtime").checked = run.t.length > 2 && wantsLogTime(run.t);
  }
  offerOthers();
  byId("clock").hidden = run.t.length < 2;
  if (run.t.length > 1) clock.set(run);
  draw();
  stage.show(run);
}

function tellMessage(message) {
  byId("message").textContent = message ?? "";
  byId("message").hidden = !message;
}

function drawCurves({ hurried = false } = {}) {
  const runs = [shown, other].filter((run) => run !== null);
  const chosen = [...byId("fields").querySelectorAll("input:checked")].map((input) => input.value);
  const ghosts = ghost !== null && ghost !== shown && other === null ? ghost : null;
  plots.show(runs, chosen, { specification: shown?.specification, logTime: byId("logtime").checked, ghost: ghosts, hurried });
  drawPhase();
}

function draw() {
  const runs = [shown, other].filter((run) => run !== null);
  byId("verdict").replaceChildren(...verdicts(runs).filter((part) => part !== null));
  drawCurves();
  byId("claims").replaceChildren(...(shown && Object.keys(shown.diagnostics).length > 0 ? [claims(shown, GUIDE)] : []));
  // While a slider is dragged, tables that are folded need no update.
  if (byId("raw").open || ghost === null) showEvidence();
  byId("legend").hidden = other === null;
  byId("legend").textContent = other === null ? "" : `Solid: ${shown.label ?? "without a label"}. Dashed: ${other.label ?? "without a label"}.`;
  const warnings = runs.flatMap((run) => run.diagnostics.warnings ?? []);
  byId("warnings").hidden = warnings.length === 0;
  byId("warnings").replaceChildren(
    ...warnings.map((warning) => element("li", {}, warning.message, " ", warning.code ? element("a", { href: `${service.base}/docs/codes#${warning.code}` }, "more") : null)),
  );
}

function offerFields() {
  const names = Object.keys(shown?.fields ?? {});
  offerMap();
  const boxes = names.map((name, i) =>
    element("label", {}, element("input", { type: "checkbox", value: name, checked: i < PANELS, change: draw }), name),
  );
  byId("fields").replaceChildren(element("legend", {}, "Fields"), ...boxes);
  const options = () => [element("option", { value: "t" }, "t"), ...names.map((name) => element("option", { value: name }, name))];
  byId("horizontal").replaceChildren(...options());
  byId("vertical").replaceChildren(...options());
  byId("horizontal").value = names[0] ?? "t";
  byId("vertical").value = names[1] ?? names[0] ?? "t";
}

function showEvidence() {
  const runs = [shown, other].filter((run) => run !== null);
  byId("evidence").replaceChildren(...(runs.length > 0 ? evidence(runs) : []));
}

let phase = null;

function drawPhase() {
  if (!byId("phasebox").open || shown === null || shown.t.length < 2) return;
  phase = phaseFigure(shown, byId("horizontal").value, byId("vertical").value, {
    title: shown.label ?? "",
    specification: shown.specification,
    describe,
    equal: byId("equal").checked,
  });
  byId("phase").replaceChildren(phase.figure);
}

function offerDownloads() {
  const { id, text } = shown ?? {};
  const buttons = FORMATS.map(([name, type, extension]) =>
    element("button", { type: "button", click: () => save(() => (id ? service.download(id, type) : service.solveAs(text, type)), `${id ?? "answer"}.${extension}`) }, name),
  );
  byId("downloads").replaceChildren(...(id || text ? buttons : []));
}

async function save(fetched, name) {
  try {
    const address = URL.createObjectURL(await fetched());
    element("a", { href: address, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(address), 1000);
  } catch (refusal) {
    tellMessage(refusal.message);
  }
}

const asSvg = (figure) => new Blob([textOf(figure)], { type: "image/svg+xml" });

// Returns a copy of a figure without the mark of the current time, for printing.
function unmarked(figure) {
  const copy = figure.cloneNode(true);
  copy.querySelector(".now")?.remove();
  return copy;
}

const ground = () => getComputedStyle(document.body).backgroundColor;

// Saves the picture of the answer at the time of the cursor as a PNG file.
async function picture() {
  const canvas = byId("stage").querySelector("canvas");
  if (canvas === null) return tellMessage("There is no picture.");
  const { still } = await import("./standalone.js");
  stage.draw(clock.time);
  await save(() => still(canvas, ground()), "picture.png");
}

// Saves everything that is shown of an answer in one HTML file.
async function html() {
  const { standalone } = await import("./standalone.js");
  const { label, text, specification, t } = shown;
  await save(async () => standalone({
    title: label ?? "Answer", text: text ?? JSON.stringify(specification, null, 2), t, canvas: t.length > 1 ? byId("stage").querySelector("canvas") : null,
    draw: (time) => stage.draw(time), background: ground(), figure: panelsNow(), verdict: byId("verdict"), claims: byId("claims"),
  }), "answer.html");
  stage.draw(clock.time);
}

// Records the picture of the answer, played once over its time horizon, and saves it as a film.
async function film() {
  const canvas = byId("stage").querySelector("canvas");
  if (canvas === null) return tellMessage("There is no moving picture.");
  byId("webm").disabled = true;
  byId("webm").textContent = "Recording ...";
  try {
    await save(() => record(canvas, clock, ground()), "film.webm");
  } finally {
    byId("webm").disabled = false;
    byId("webm").textContent = "Film WebM";
  }
}

const panelsNow = () =>
  panelsFigure(plots.figure(), { title: shown?.label ?? "", specification: shown?.specification, span: plots.span, logTime: byId("logtime").checked });

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
      other = await fetchRun(id, remembered().find((job) => job.id === id)?.label, null);
    } catch (refusal) {
      tellMessage(refusal.message);
    }
  }
  draw();
}

// ---- the jobs of this browser, and of this token

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
  // The service may have deleted the job already, so that an error is ignored.
  await service.forget(id).catch(() => {});
  offerOthers();
}

function toggleJobs(open = byId("jobtable").hidden) {
  byId("jobtable").hidden = !open;
  byId("list").setAttribute("aria-expanded", String(open));
  jobs.show(open);
}

// ---- opening the job or the specification that the URL names

async function openAddressed() {
  const hash = new URLSearchParams(location.hash.slice(1));
  const id = hash.get("job") ?? new URLSearchParams(location.search).get("job");
  const letters = hash.get("s");
  if (letters) return openLink(letters);
  const name = hash.get("example");
  if (name && [...byId("example").options].some(({ value }) => value === name)) return choose(name);
  if (id && id !== shown?.id && id !== followed) {
    toggleJobs(false);
    await watch(id);
  }
}

async function openLink(letters) {
  let text;
  try {
    text = await unpacked(letters);
  } catch {
    return tellMessage("The link is damaged: its specification cannot be read.");
  }
  fill(text);
  tellMessage();
  await checkText();
  if (isSmall(text)) live.solve(text);
  else markStale("The link brought another specification: press Solve to run it. What stands below is of an earlier text.", "The link brought a specification that is not small: press Solve to run it.");
}

async function share() {
  const { text } = editor;
  const address = `${location.origin}${location.pathname}#s=${await packed(text)}`;
  history.replaceState(null, "", address);
  try {
    await navigator.clipboard.writeText(address);
    byId("shared").textContent = "Copied: the link carries the whole specification, and no token.";
  } catch {
    byId("shared").textContent = "The link stands in the address bar: it carries the whole specification, and no token.";
  }
}

async function choose(name) {
  byId("example").value = name;
  live.stop();
  leave?.abort();
  followed = null;
  byId("progress").hidden = true;
  const hadFocus = byId("gallery").contains(document.activeElement);
  forgetShown();
  byId("before").hidden = false;
  byId("before").textContent = "Loading the example ...";
  try {
    const text = await service.example(name);
    if (byId("example").value !== name) return; // another example was chosen meanwhile
    ghost = null;
    quick = true;
    fill(text);
    history.replaceState(null, "", `#example=${name}`);
    tellMessage();
    if (hadFocus) byId("result").focus();
    const runs = byId("live").checked && isSmall(text);
    awaited = runs ? text : null;
    markStale("", runs ? "Solving ..." : "Press Solve: this example is not run by itself.");
    if (runs) live.solve(text);
    await checkText();
    bringResult();
  } catch (refusal) {
    byId("before").hidden = true;
    tellMessage(refusal.message);
  }
}

function browse() {
  toggleJobs(false);
  byId("empty").hidden = false;
  byId("empty").scrollIntoView();
  byId("gallery").querySelector("button")?.focus();
}

// ---- connecting the controls of the page with their functions

async function start() {
  byId("solve").addEventListener("click", solve);
  byId("format").addEventListener("click", () => {
    try {
      editor.text = JSON.stringify(JSON.parse(editor.text), null, 2);
    } catch {
      checkText();
    }
  });
  byId("share").addEventListener("click", share);
  byId("live").addEventListener("change", (event) => {
    quick = true;
    if (!event.target.checked) live.stop();
    else textRested();
  });
  byId("cancel").addEventListener("click", () => service.cancel(followed).catch((refusal) => tellMessage(refusal.message)));
  byId("other").addEventListener("change", compare);
  byId("logtime").addEventListener("change", draw);
  byId("svg").addEventListener("click", () => save(async () => asSvg(panelsNow()), "figure.svg"));
  byId("png").addEventListener("click", () => save(() => png(panelsNow()), "figure.png"));
  byId("still").addEventListener("click", picture);
  byId("html").addEventListener("click", html);
  byId("webm").hidden = !canRecord();
  byId("webm").addEventListener("click", film);
  byId("phasebox").addEventListener("toggle", drawPhase);
  byId("mapbox").addEventListener("toggle", openMap);
  byId("raw").addEventListener("toggle", showEvidence);
  for (const id of ["horizontal", "vertical", "equal"]) byId(id).addEventListener("change", drawPhase);
  byId("phasesvg").addEventListener("click", () => phase && save(async () => asSvg(unmarked(phase.figure)), "phase.svg"));
  byId("phasepng").addEventListener("click", () => phase && save(() => png(unmarked(phase.figure)), "phase.png"));
  byId("example").addEventListener("change", (event) => event.target.value !== "" && choose(event.target.value));
  byId("browse").addEventListener("click", browse);
  byId("list").addEventListener("click", () => toggleJobs());
  clock.listen((time) => {
    plots.setTime(time);
    stage.draw(time);
    if (phase && shown && byId("phasebox").open) phase.move(nearestTo(shown.t, time));
  });
  plots.picked = (time) => clock.go(time);
  addEventListener("tokenrequired", () => (byId("access").hidden = false));
  byId("use").addEventListener("click", () => {
    service.useToken(byId("token").value.trim());
    byId("token").value = "";
    byId("access").hidden = true;
    checkText();
    openAddressed();
  });
  addEventListener("hashchange", openAddressed);
  byId("clock").hidden = true;
  listJobs();
  try {
    const examples = await service.examples();
    for (const { name, title } of examples) byId("example").append(element("option", { value: name }, title));
    byId("gallery").replaceChildren(...gallery(examples, choose));
    new Previews(byId("gallery"));
  } catch (refusal) {
    tellCheck([], [element("p", { class: "bad" }, refusal.message)]);
  }
  await openAddressed();
}

start();
