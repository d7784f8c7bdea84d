// Uses a client that is generated from the OpenAPI description: solves at once and as a job, meets an error, follows
// a job to its end, and requests a part of a result.
import { check, continueJob, findJob, findResults, followJob, listJobs, solve } from "./client/index.js";
import { client } from "./client/client.gen.js";
import type { Solution, Specification } from "./client/types.gen.js";

const [address] = process.argv.slice(2);
if (address === undefined) throw new Error("usage: solve.js ADDRESS");
client.setConfig({ baseUrl: address });

function expect(right: boolean, what: string): asserts right {
  if (!right) throw new Error(what);
}

// The solution of x' = -x with x(0) = 1 is exp(-t).
const decay = (rate: string): Specification => ({
  label: "a decay",
  problem: { dvi: { states: { x: { initial: 1, rate } } } },
  time: { end: 1 },
  method: { rtol: 1e-9 },
});

const close = (solution: Solution, end: number) => {
  const x = solution.trajectory.fields.x;
  expect(x !== undefined, "no column x");
  expect(Math.abs(Number(x.at(-1)) - Math.exp(-end)) < 1e-7, `x(${end}) = ${x.at(-1)}`);
};

const solved = await solve({ body: decay("-x") });
expect(solved.data !== undefined && "trajectory" in solved.data, JSON.stringify(solved.error));
close(solved.data, 1);
expect(solved.data.verdict?.trusted === true, "the answer is not trusted");

const wrong = await solve({ body: decay("-y") });
expect(wrong.error !== undefined && wrong.response?.status === 400, "an unknown name is taken");
expect(wrong.error.errors?.[0]?.pointer === "/problem/dvi/states/x/rate", JSON.stringify(wrong.error));

const checked = await check({ body: decay("-x") });
expect(checked.error === undefined, JSON.stringify(checked.error));

const posted = await solve({ body: decay("-x"), headers: { prefer: "respond-async" } });
expect(posted.data !== undefined && "id" in posted.data, JSON.stringify(posted.error));
const id = posted.data.id;
const { stream } = await followJob({ path: { id } });
for await (const _ of stream) {
  // The stream of events ends with the job.
}
const job = await findJob({ path: { id } });
expect(job.data?.status === "successful", JSON.stringify(job.data ?? job.error));
const excerpt = await findResults({ path: { id }, query: { fields: "x", from: 0.5 } });
expect(excerpt.data !== undefined, JSON.stringify(excerpt.error));
close(excerpt.data as Solution, 1);

const further = await continueJob({ path: { id }, body: { end: 2 } });
expect(further.data !== undefined, JSON.stringify(further.error));
let state = further.data;
while (state.status === "accepted" || state.status === "running") {
  const found = await findJob({ path: { id: state.id } });
  expect(found.data !== undefined, JSON.stringify(found.error));
  state = found.data;
}
const rest = await findResults({ path: { id: state.id } });
close(rest.data as Solution, 2);
const listed = await listJobs({ query: { label: "a decay" } });
expect((listed.data?.jobs.length ?? 0) >= 2, JSON.stringify(listed.data));
console.log("ok  the generated client solves, is refused, follows, continues and lists");
