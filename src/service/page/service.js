// The service as this page uses it. What fails throws a `Refused` with the problem (RFC 9457) that says why.

export class Refused extends Error {
  constructor(problem) {
    super(problem.detail ?? problem.title);
    this.problem = problem;
  }
}

// Where the service asks for a token, it is kept until the tab is closed, and told with every request.
const token = () => sessionStorage.getItem("token");
export const useToken = (text) => sessionStorage.setItem("token", text);

async function ask(address, options = {}) {
  const headers = token() ? { ...options.headers, authorization: `Bearer ${token()}` } : options.headers;
  let response;
  try {
    response = await fetch(address, { ...options, headers });
  } catch {
    throw new Refused({ title: "The service does not answer", detail: "The service does not answer.", errors: [] });
  }
  if (response.ok) return response;
  if (response.status === 401) dispatchEvent(new Event("tokenrequired"));
  const type = response.headers.get("content-type") ?? "";
  const problem = type.includes("json") ? await response.json() : { title: `The service answered ${response.status}` };
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
export const submit = (text) => json("/solve", posted(text, { prefer: "respond-async" }));
export const job = (id) => json(`/jobs/${encodeURIComponent(id)}`);
export const cancel = (id) => json(`/jobs/${encodeURIComponent(id)}/cancel`, { method: "POST" });
export const forget = (id) => ask(`/jobs/${encodeURIComponent(id)}`, { method: "DELETE" });
export const results = (id) => json(`/jobs/${encodeURIComponent(id)}/results`, accepting("application/json"));
export const download = async (id, type) =>
  (await ask(`/jobs/${encodeURIComponent(id)}/results`, accepting(type))).blob();

const accepting = (type) => ({ headers: { accept: type } });

export const ended = (status) => !["accepted", "running"].includes(status.status);

// Tells `report` every state of the job until it has ended; the last one is the answer.
export async function follow(id, report) {
  for (let pause = 50; ; pause = Math.min(pause * 1.5, 1000)) {
    const status = await job(id);
    report(status);
    if (ended(status)) return status;
    await new Promise((resume) => setTimeout(resume, pause));
  }
}
