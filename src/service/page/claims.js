// The evidence of an answer for people: one sentence, then each claim with a light, what it rests on, and the chapter
// of the guide that explains it.
//
// A light is green if the claim was proven, or measured within what is allowed, amber if nothing is known, red if a
// measurement speaks against the claim. A claim that was not measured is not shown as good.

import { element } from "./element.js";
import { number } from "./numbers.js";

const UNIQUENESS = {
  unique: ["good", "Unique", "A solution exists and is unique."],
  locally_unique: ["good", "Locally unique", "A solution exists and is unique up to points at which the equations are not Lipschitz."],
  exists_not_certified: ["doubt", "A solution", "A solution exists; its uniqueness is not certified."],
  not_certified: ["doubt", "Uniqueness open", "Neither existence nor uniqueness is certified."],
  not_unique: ["bad", "Not unique", "Solutions are not unique in general: one of them was computed."],
  not_analysed: ["doubt", "Not analysed", "Existence and uniqueness were not analysed."],
};

const CHECKS = {
  law_residual: ["The law holds", "complementarity, friction and impact laws, by the residual of the natural map"],
  constraint_residual: ["Constraints hold", "constraints on the active face, hidden ones included, at and between the outputs"],
  joint_drift: ["Joints hold", "violation of a joint"],
  energy_balance: ["Energy is balanced", "energy, work, friction, viscosity and impacts"],
  events_unproven: ["No event was missed", "steps that are not proven free of an undetected event"],
  local_error: ["Steps are accurate", "largest local error of a step, in units of atol + rtol |x|"],
  global_error: ["The end is accurate", "estimated error at the end, in units of atol + rtol |x|"],
  derivatives: ["Derivatives agree", "derivatives against a difference of two runs, in units of its uncertainty"],
  return_residual: ["The run returns to its start", "distance between the end and the start of the run, in units of atol + rtol |x|"],
  accumulation_passed: ["Accumulations are accurate", "distance of an accumulation of events from its limit"],
  other_solutions: ["No other solutions are known", "size of a negative determinant of an active face, which proves other solutions"],
  fit_distance: ["The minimum was reached", "distance of the estimates from the minimum that the derivatives predict, in standard errors"],
  untrusted_members: ["Members are trusted", "number of members of the table that are not trusted"],
  not_at_end: ["The end was reached", "time from the end of the run to the requested end; 1 for a search without an answer"],
};

const capital = (words) => `${words[0].toUpperCase()}${words.slice(1)}`;
const size = (value) => (Math.abs(value) >= Number.MAX_VALUE ? "not finite" : number(value, 2));
const counted = (n, one, many) => `${n === 0 ? "No" : number(n)} ${n === 1 ? one : many}`;

// Returns the claims on an answer (a solution with its diagnostics): {light, title, rests, code} for each.
export function claimsOf({ status, diagnostics = {}, t = [] }) {
  const claims = [];
  const checks = diagnostics.checks ?? {};
  const [light, , told] = UNIQUENESS[diagnostics.uniqueness] ?? ["doubt", "", `Uniqueness: ${String(diagnostics.uniqueness ?? "not analysed").replaceAll("_", " ")}.`];
  if (!("not_at_end" in checks)) {
    const reached = status === "completed";
    claims.push({ light: reached ? "good" : "bad", title: reached ? "The end was reached" : `The run ended early (${String(status).replaceAll("_", " ")})`, rests: t.length > 0 ? `t = ${number(t.at(-1))}` : "", code: "not_at_end" });
  }
  claims.push({ light, title: told, rests: diagnostics.because ?? "", code: "uniqueness" });
  for (const [code, { value, allowed }] of Object.entries(checks)) {
    const [title, meaning] = CHECKS[code] ?? [capital(code.replaceAll("_", " ")), "a check unknown to this page"];
    const within = value <= allowed;
    claims.push({ light: within ? "good" : "bad", title: within ? title : `${title}: no`, rests: `${meaning}: ${size(value)}, allowed ${size(allowed)}`, code });
  }
  if (!("global_error" in checks)) {
    claims.push({ light: "unknown", title: "Error at the end: not measured", rests: "\"output\": {\"global_error\": true} measures it, by a second and more accurate run", code: "global_error" });
  }
  const { screening } = diagnostics;
  if (screening && !("events_unproven" in checks)) {
    const missed = screening.missed ?? 0;
    const open = screening.undecided ?? 0;
    claims.push({
      light: missed > 0 ? "bad" : open > 0 ? "doubt" : "good",
      title: missed > 0 ? "Events were missed" : open > 0 ? "Some steps may hide an event" : "No event was missed",
      rests: `${number(screening.proven ?? 0)} steps proven free of events, ${number(open)} undecided, ${number(missed)} missed`,
      code: "events_unproven",
    });
  }
  return claims;
}

// Returns the sentence about the evidence of an answer that is shown before its claims.
export function sentenceOf({ verdict, status, diagnostics = {} }) {
  const checks = diagnostics.checks ?? {};
  const parts = [];
  if (status !== "completed") parts.push(`The run ${String(status ?? "ended").replaceAll("_", " ")} before its end`);
  else if (verdict && !verdict.trusted) parts.push("The end was reached, but the solution fails checks");
  const uniqueness = UNIQUENESS[diagnostics.uniqueness]?.[1];
  if (uniqueness) parts.push(uniqueness);
  const states = diagnostics.global_error?.states;
  if (states) parts.push(`Error about ${size(Math.max(...Object.values(states).map(Math.abs)))} at the end`);
  else if (checks.local_error) parts.push("Steps within the tolerance");
  const tail = [];
  if (typeof diagnostics.switches === "number") tail.push(counted(diagnostics.switches, "switch", "switches").toLowerCase());
  if (checks.energy_balance && checks.energy_balance.value <= checks.energy_balance.allowed) {
    const { energy } = diagnostics;
    const scale = Math.max(...Object.entries(energy ?? {}).filter(([key]) => /^(kinetic|potential)/.test(key)).map(([, one]) => Math.abs(one)), 0);
    tail.push(scale > 0 ? `energy balanced to ${size(checks.energy_balance.value / scale)} of itself` : `energy balanced to ${size(checks.energy_balance.value)}`);
  }
  if (tail.length > 0) parts.push(capital(tail.join(", ")));
  return `${parts.join(". ")}.`;
}

const SIGNS = { good: "●", doubt: "◐", bad: "✕", unknown: "○" };
const WORDS = { good: "holds", doubt: "not certain", bad: "fails", unknown: "not measured" };

export function claims(run, guide) {
  const items = claimsOf(run).map(({ light, title, rests, code }) =>
    element(
      "li",
      { class: `claim ${light}` },
      element("span", { class: "light", role: "img", "aria-label": WORDS[light], title: WORDS[light] }, SIGNS[light]),
      element("span", {}, element("b", {}, title), " ", element("span", { class: "rests" }, rests), " ", element("a", { href: `${guide}#${code}`, "aria-label": `why? ${code.replaceAll("_", " ")}` }, "why?")),
    ),
  );
  return element("ul", { class: "claims" }, ...items);
}
