// The requests of this page to the service. A request that fails throws a `Refused` with the problem (RFC 9457) that
// says why.

import { events } from "./events.js";

export class Refused extends Error {
  constructor(problem) {
    super(problem.detail ?? problem.title);
    this.problem = problem;
  }
}

// The path prefix of every URL of the service; empty if the service is at the root of its host.
export const base = new URL("..", import.meta.url).pathname.slice(0, -1);

// An access token that the service requires is kept until the tab is closed, and sent with every request.
const token = () => sessionStorage.getItem("token");
export const useToken = (text) => sessionStorage.setItem("token", text);

// Says what an access token does not allow, in the words of this page.
const lacking = (options) =>
  (options.method ?? "GET") === "GET"
    ? "Your token does not allow reading jobs; use another."
    : "Your token allows reading jobs, but not checking, solving or cancelling; use another.";

// Sends a request to the service. If an access token is missing, the page asks the user for one, unless `quiet` says
// that nobody waits for the answer.
async function ask(address, { quiet = false, ...options } = {}) {
  const headers = token() ? { ...options.headers, authorization: `Bearer ${token()}` } : options.headers;
  let response;
  try {
    response = await fetch(base + address, { ...options, headers });
  } catch (error) {
    if (options.signal?.aborted) throw error;
    throw new Refused({ title: "The service does not answer", detail: "The service does not answer.", errors: [] });
  }
  if (response.ok) return response;
  const type = response.headers.get("content-type") ?? "";
  const problem = type.includes("json") ? await response.json() : { title: `The service answered ${response.status}` };
  const lacks = problem.type?.endsWith("/problems/scope-missing");
  if (lacks) problem.detail = lacking(options);
  if ((lacks || response.status === 401) && !quiet) dispatchEvent(new Event("tokenrequired"));
  const wait = response.headers.get("retry-after");
  throw new Refused(wait ? { ...problem, retryAfter: Number(wait) } : problem);
}

const json = async (address, options) => (await ask(address, options)).json();

const posted = (body, headers = {}) => ({
  method: "POST",
  headers: { "content-type": "application/json", ...headers },
  body,
});

export const examples = () => json("/examples");
export const example = async (name) => (await ask(`/examples/${encodeURIComponent(name)}`)).text();
export const check = (text, signal) => json("/check", { ...posted(text), signal });
export const schema = () => json("/schema");
export const version = () => json("/version");

// Solves a specification within `seconds`; returns its answer, or `null` if it takes longer. The request leaves no
// job behind. Aborting `signal` cancels the solve at the service.
export async function solveNow(text, seconds, signal, { quiet = false } = {}) {
  const limit = AbortSignal.timeout(seconds * 1000);
  const either = AbortSignal.any([signal, limit]);
  try {
    const response = await ask("/solve", { ...posted(text, { prefer: `wait=${Math.ceil(seconds) + 1}, transient` }), signal: either, quiet });
    const answer = await response.json();
    return response.status === 200 ? answer : null;
  } catch (error) {
    if (limit.aborted && !signal.aborted) return null;
    throw error;
  }
}

// Returns the answer to a specification as a file of media type `type`.
export const solveAs = async (text, type) => (await ask("/solve", posted(text, { accept: type, prefer: "wait=60" }))).blob();

// Returns a page of the list of this client's jobs, and the cursor of the next page.
export async function jobs(status, cursor) {
  const query = new URLSearchParams({ limit: "50", ...(status ? { status } : {}), ...(cursor ? { cursor } : {}) });
  const response = await ask(`/jobs?${query}`);
  const next = /[?&]cursor=([^&>]+)[^>]*>; *rel="?next/.exec(response.headers.get("link") ?? "")?.[1] ?? null;
  return { jobs: (await response.json()).jobs, next: next && decodeURIComponent(next) };
}

export const specification = async (id) => (await ask(`/jobs/${encodeURIComponent(id)}/specification`)).text();
export const submit = (text) => json("/solve", posted(text, { prefer: "respond-async" }));
export const cancel = (id) => json(`/jobs/${encodeURIComponent(id)}/cancel`, { method: "POST" });
export const forget = (id) => ask(`/jobs/${encodeURIComponent(id)}`, { method: "DELETE" });
export const results = (id) => json(`/jobs/${encodeURIComponent(id)}/results`, accepting("application/json"));
export const download = async (id, type) =>
  (await ask(`/jobs/${encodeURIComponent(id)}/results`, accepting(type))).blob();

const accepting = (type) => ({ headers: { accept: type } });

const PAUSE = 1; // seconds before a stream that broke off is requested again

// Reports every status of a job to `report` until the job has ended; returns the last status, nothing if `signal` is
// aborted.
export async function follow(id, report, signal) {
  const asked = { ...accepting("text/event-stream"), signal };
  for (;;) {
    let pause = PAUSE;
    try {
      for await (const { event, data } of events(await ask(`/jobs/${encodeURIComponent(id)}/events`, asked))) {
        if (event === "switch") continue;
        const status = JSON.parse(data);
        report(status);
        if (event === "done") return status;
      }
    } catch (error) {
      if (signal.aborted) return null;
      if (error instanceof Refused && !error.problem.retryAfter) throw error;
      pause = error.problem?.retryAfter ?? PAUSE;
    }
    await new Promise((resume) => setTimeout(resume, pause * 1000));
  }
}
