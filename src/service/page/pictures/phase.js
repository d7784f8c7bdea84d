// The phase plane of a Filippov system, or of any problem with two states: the trajectory, the surfaces where the
// rates jump, and the parts of the surfaces along which the trajectory slides.

import { compile, parameterValues } from "../expressions.js";
import { range } from "../fields.js";
import { axis, padded } from "../figure.js";
import { between, film, mixed } from "./film.js";
import { statesOf } from "./kinds.js";
import { dot, line, surface } from "./surface.js";

const FRAMES = 801;
const CELLS = 90; // number of cells along each axis in which the surface is located
const INSIDE = 1e-6; // the system slides if the weight of one side differs from 0 and 1 by more than this

export function needs(specification) {
  if (!statesOf(specification)) return null;
  return { ...film(specification), output: { times: { count: FRAMES } } };
}

// Returns functions of the state that are zero on the surfaces where the rates of a Filippov system jump.
function surfacesOf({ filippov }) {
  if (!filippov) return [];
  if (filippov.surface !== undefined) return [compile(filippov.surface)].filter((one) => one !== null);
  const indicators = (filippov.regions ?? []).map(({ indicator }) => compile(indicator));
  if (indicators.some((one) => one === null)) return [];
  // On the surface between two regions of a Filippov system the indicators of both are equal, and no other indicator is
  // smaller.
  return indicators.flatMap((a, i) =>
    indicators.slice(i + 1).map((b) => (scope) => {
      const both = [a(scope), b(scope)];
      return Math.min(...indicators.map((one) => one(scope))) < Math.min(...both) - 1e-12 ? NaN : both[0] - both[1];
    }),
  );
}

export function make(specification, run, { canvas: standing } = {}) {
  const [first, second] = statesOf(specification);
  const [us, vs] = [run.fields[first], run.fields[second]];
  if (!us || !vs) return null;
  const [problem] = Object.values(specification.problem);
  const parameters = parameterValues(problem.parameters);
  const [xs, ys] = [padded(range(us)), padded(range(vs))];
  const surfaces = surfacesOf(specification.problem);
  const shares = Object.keys(run.fields).filter((name) => /^z\d*$/.test(name)).map((name) => run.fields[name]);
  const slides = (k) => specification.problem.filippov !== undefined && shares.some((share) => share[k] > INSIDE && share[k] < 1 - INSIDE);
  let time = run.t[0];

  // The segments of all surfaces where the rates jump: located anew at each time if they depend on time, otherwise
  // once.
  let sought = null;
  const zeros = () => {
    if (sought !== null) return sought;
    let moves = false;
    const valueOf = (name) => {
      moves ||= name === "t";
      return name === "t" ? time : parameters[name];
    };
    const found = surfaces.flatMap((surface) => {
      const at = (u, v) => {
        try {
          return surface((name) => (name === first ? u : name === second ? v : valueOf(name)));
        } catch {
          return NaN;
        }
      };
      return zeroLines(at, xs, ys);
    });
    if (!moves) sought = found;
    return found;
  };

  const paint = (context, { width, height, colour }) => {
    const [x, y] = [axis(xs, [56, width - 14]), axis(ys, [height - 40, 12])];
    context.fillStyle = colour("--quiet");
    context.textAlign = "center";
    x.values.forEach((value, i) => {
      line(context, [[x.at(value), 12], [x.at(value), height - 40]], colour("--grid"), 1);
      context.fillText(x.labels[i], x.at(value), height - 24);
    });
    context.fillText(first, width / 2, height - 8);
    context.textAlign = "right";
    y.values.forEach((value, i) => {
      line(context, [[56, y.at(value)], [width - 14, y.at(value)]], colour("--grid"), 1);
      context.fillText(y.labels[i], 50, y.at(value) + 4);
    });
    context.save();
    context.translate(12, height / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(second, 0, 0);
    context.restore();
    for (const [a, b] of zeros()) line(context, [[x.at(a[0]), y.at(a[1])], [x.at(b[0]), y.at(b[1])]], colour("--quiet"), 1.6);
    const points = us.map((u, k) => [x.at(u), y.at(vs[k])]);
    line(context, points, colour("--accent"), 1.6);
    for (let k = 0; k + 1 < points.length; k += 1) if (slides(k) && slides(k + 1)) line(context, [points[k], points[k + 1]], colour("--hot"), 3.2);
    const now = between(run.t, time);
    const next = Math.min(now.k + 1, run.t.length - 1);
    dot(context, x.at(mixed(us, now.k, next, now.part)), y.at(mixed(vs, now.k, next, now.part)), 6, colour("--hot"));
  };
  const { canvas, redraw, dispose } = surface(`The phase plane of ${first} and ${second}`, 380, paint, standing);
  const hint = surfaces.length > 0 ? "Grey: where the rates jump; red: where the solution slides along it." : "The trajectory, with the time of the cursor.";
  return { element: canvas, dispose, draw: (to) => ((time = to), redraw()), hint };
}

// Returns the zero lines of a function by marching squares: segments between the zeros on the edges of each cell.
function zeroLines(f, [x0, x1], [y0, y1]) {
  const [dx, dy] = [(x1 - x0) / CELLS, (y1 - y0) / CELLS];
  const values = [];
  for (let j = 0; j <= CELLS; j += 1) values.push(Array.from({ length: CELLS + 1 }, (_, i) => f(x0 + i * dx, y0 + j * dy)));
  const segments = [];
  for (let j = 0; j < CELLS; j += 1) {
    for (let i = 0; i < CELLS; i += 1) {
      const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
      const at = corners.map(([a, b]) => values[b][a]);
      if (!at.every(Number.isFinite)) continue;
      const zeros = [];
      for (let k = 0; k < 4; k += 1) {
        const [p, q, fp, fq] = [corners[k], corners[(k + 1) % 4], at[k], at[(k + 1) % 4]];
        if (fp > 0 === fq > 0) continue;
        const part = fp / (fp - fq);
        zeros.push([x0 + (p[0] + part * (q[0] - p[0])) * dx, y0 + (p[1] + part * (q[1] - p[1])) * dy]);
      }
      for (let k = 0; k + 1 < zeros.length; k += 2) segments.push([zeros[k], zeros[k + 1]]);
    }
  }
  return segments;
}
