// The picture of rigid bodies in space, drawn by three.js: shapes with their shadows, joints and springs, trails, and
// the resultant contact force on each body as an arrow. The script of three.js is fetched only if there is a scene.
//
// The poses come from a solve of their own at the times of a film, since a specification may select other fields.

import { element } from "../element.js";
import { parameterValues, value } from "../expressions.js";
import { between, film, mixed } from "./film.js";
import { Pace } from "./pace.js";
import { Shapes } from "./shapes.js";

const FRAMES = 241;
const FRAMES_OF_MANY = 121;
const MANY = 40; // number of bodies above which forces and trails are not drawn
const SIDES = 24; // number of sides of the polygon drawn for a circle
const SIDES_OF_MANY = 12; // number of sides if a processor without a graphics card draws many bodies
const MOST = 1500; // largest number of bodies that are drawn
const RESTS = 250; // milliseconds after the last frame until the picture is drawn in full quality
const POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"];
const COLOURS = [0x2f6fab, 0xc2571a, 0x2b7d46, 0x8a3f8f, 0xb08900, 0x00798c, 0xa4262c, 0x6b7280];

// Whether a name in a specification stands for several bodies, such as `ball[1..3]`, which this picture does not draw.
const isRange = (name) => /\.\./.test(name ?? "");

export function named(bodies) {
  return bodies.map((body, i) => ({ ...body, name: body.name ?? `body${i + 1}` }));
}

export function needs(specification) {
  const scene = specification.problem.rigid_bodies;
  const bodies = named(scene.bodies ?? []);
  // The bodies of a robot description are known to the service only, so that the picture cannot draw them.
  if (scene.robot || bodies.length > MOST || bodies.some(({ name }) => isRange(name))) return null;
  const moving = bodies.filter((body) => !body.fixed && !body.motion);
  const withForces = bodies.length <= MANY;
  const forces = withForces ? moving.flatMap(({ name }) => ["x", "y", "z"].map((axis) => `${name}.contact_f${axis}`)) : [];
  const shown = withForces ? scene.bodies.map((body) => (body.fixed || body.motion ? body : { ...body, contact_forces: true })) : scene.bodies;
  return {
    ...film(specification),
    problem: { rigid_bodies: { ...scene, bodies: shown } },
    output: {
      times: { count: bodies.length > MANY ? FRAMES_OF_MANY : FRAMES },
      fields: [...moving.flatMap(({ name }) => POSE.map((key) => `${name}.${key}`)), ...forces],
    },
  };
}

export async function make(specification, run, { bundle }) {
  const three = await import(bundle("three.js"));
  const scene = specification.problem.rigid_bodies;
  const scope = parameterValues(scene.parameters);
  const number = (expression, otherwise = 0) => {
    const found = value(expression ?? otherwise, { t: run.t[0], ...scope });
    return Number.isFinite(found) ? found : otherwise;
  };
  const vector = (list, otherwise) => (list ?? otherwise).map((one, i) => number(one, otherwise[i]));
  const world = new three.Scene();
  const canvas = element("canvas", { "aria-label": "The bodies in space; drag to turn, wheel to come nearer", role: "img", tabindex: "0" });
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const software = drawsInSoftware();
  let renderer;
  try {
    renderer = new three.WebGLRenderer({ canvas, antialias: !software, alpha: true });
  } catch {
    throw new Error("This browser has no WebGL: the scene cannot be drawn here.");
  }
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = three.BasicShadowMap;

  const gravity = new three.Vector3(...vector(scene.gravity, [0, 0, 0]));
  const up = gravity.length() > 0 ? gravity.clone().multiplyScalar(-1).normalize() : new three.Vector3(0, 0, 1);

  const bodies = named(scene.bodies);
  const taxed = software && bodies.length > MANY;
  const shapes = new Shapes(three, number, vector, taxed ? SIDES_OF_MANY : SIDES);
  const movers = [];
  const still = new three.Vector3();
  const poses = [];
  bodies.forEach((body, i) => {
    const colour = body.fixed ? (dark ? 0x5a6472 : 0xb9c0c8) : COLOURS[i % COLOURS.length];
    const columns = body.motion ? givenMotion(body, run.t, scope) : POSE.map((key) => run.fields[`${body.name}.${key}`]);
    const place = vector(body.position, [0, 0, 0]);
    const turn = vector(body.orientation, [1, 0, 0, 0]);
    const group = new three.Group();
    shapes.add(group, body.shape, colour, body.fixed);
    world.add(group);
    group.position.set(...place);
    group.quaternion.set(turn[1], turn[2], turn[3], turn[0]).normalize();
    poses.push({ name: body.name, group, start: { position: group.position.clone(), quaternion: group.quaternion.clone() } });
    if (columns.every((column) => column !== undefined)) movers.push({ group, columns, body, colour });
  });

  // The box that the bodies cover in all frames of the film, without grounds, which are unbounded.
  const [low, high] = [new three.Vector3(Infinity, Infinity, Infinity), new three.Vector3(-Infinity, -Infinity, -Infinity)];
  const cover = (point, radius) => {
    low.min(still.copy(point).addScalar(-radius));
    high.max(still.copy(point).addScalar(radius));
  };
  const point = new three.Vector3();
  for (const { columns, body } of movers) {
    const radius = shapes.radius(body.shape);
    const every = Math.max(1, Math.floor(run.t.length / 40));
    for (let k = 0; k < run.t.length; k += every) cover(point.set(columns[0][k], columns[1][k], columns[2][k]), radius);
  }
  bodies.forEach((body, i) => body.fixed && Number.isFinite(shapes.radius(body.shape)) && cover(poses[i].group.position, Math.min(shapes.radius(body.shape), 3 * (high.distanceTo(low) || 1))));
  if (!Number.isFinite(low.x)) cover(point.set(0, 0, 0), 1);
  const centre = low.clone().add(high).multiplyScalar(0.5);
  const size = Math.max(high.distanceTo(low), 1e-9);
  shapes.sizeGrounds(size, centre);

  const day = new three.HemisphereLight(0xffffff, dark ? 0x303840 : 0xb0b0a8, 1.6);
  world.add(day);
  const sun = new three.DirectionalLight(0xffffff, 1.8);
  sun.castShadow = true;
  sun.shadow.mapSize.set(software ? 512 : 1024, software ? 512 : 1024);
  Object.assign(sun.shadow.camera, { left: -size / 2, right: size / 2, top: size / 2, bottom: -size / 2, near: size / 100, far: 8 * size });
  const side = Math.abs(up.x) < 0.9 ? new three.Vector3(1, 0, 0) : new three.Vector3(0, 1, 0);
  sun.position.copy(centre).addScaledVector(up, 2.5 * size).addScaledVector(side, 0.8 * size).addScaledVector(side.clone().cross(up), 0.6 * size);
  sun.target.position.copy(centre);
  world.add(sun, sun.target);
  shapes.build(world, day, sun);

  const ink = dark ? 0xdde3ea : 0x1f2933;
  const line = (colour, points) => {
    const geometry = new three.BufferGeometry().setFromPoints(points);
    const made = new three.Line(geometry, new three.LineBasicMaterial({ color: colour }));
    made.frustumCulled = false;
    world.add(made);
    return made;
  };
  const poseOf = (name) => poses.find((one) => one.name === name);
  // Returns a function that gives the position of a point that is fixed to a body, from its position at the start.
  const carried = (at, name) => {
    const pose = poseOf(name);
    if (!pose) return () => at;
    const local = at.clone().sub(pose.start.position).applyQuaternion(pose.start.quaternion.clone().invert());
    return () => local.clone().applyQuaternion(pose.group.quaternion).add(pose.group.position);
  };
  const links = (scene.springs ?? []).map((spring) => {
    const ends = spring.at.map((at, i) => carried(new three.Vector3(...vector(at, [0, 0, 0])), spring.bodies[i]));
    return { ends, drawn: line(0xb08900, [still, still]) };
  });
  const pins = (scene.joints ?? []).flatMap((joint) => {
    const [inner] = Object.values(joint);
    if (!inner.at) return [];
    const pin = new three.Mesh(new three.SphereGeometry(size / 160, 12, 8), new three.MeshBasicMaterial({ color: ink }));
    world.add(pin);
    return [{ pin, at: carried(new three.Vector3(...vector(inner.at, [0, 0, 0])), inner.bodies[0]) }];
  });
  const trails = movers.length > MANY ? [] : movers.map(({ columns, colour }) => {
    const points = run.t.map((_, k) => new three.Vector3(columns[0][k], columns[1][k], columns[2][k]));
    return line(colour, points);
  });
  const forces = movers.flatMap(({ body, group }) => {
    const columns = ["x", "y", "z"].map((axis) => run.fields[`${body.name}.contact_f${axis}`]);
    return columns.every((column) => column !== undefined) ? [{ columns, group, drawn: line(0xa4262c, [still, still]) }] : [];
  });
  const sizes = forces.flatMap(({ columns }) => columns[0].map((x, k) => Math.hypot(x, columns[1][k], columns[2][k]))).filter((force) => force > 0).sort((a, b) => a - b);
  const typical = sizes[Math.floor(sizes.length / 2)] ?? 1;

  const camera = new three.PerspectiveCamera(35, 1.6, size / 100, size * 60);
  const view = new three.Spherical(size * 1.45, 1.15, -0.9);
  const frame = new three.Quaternion().setFromUnitVectors(new three.Vector3(0, 1, 0), up);
  camera.up.copy(up);

  // While the picture moves and frames come slowly, first shadows are dropped, then resolution. At rest, everything
  // is drawn.
  let [shadows, quality, moves, looks, later] = [!taxed, 1, false, 0, null];
  const pace = new Pace(() => {
    if (shadows) shadows = false;
    else quality = 0.6;
  });
  const look = () => {
    render();
    moves = true;
    const own = (looks += 1);
    clearTimeout(later);
    // The picture is at rest if nothing is drawn after this frame, however long the frame took.
    requestAnimationFrame(() => requestAnimationFrame(() => own === looks && (later = setTimeout(rest, RESTS))));
    pace.frame();
  };
  const rest = () => {
    moves = false;
    if (!shadows || quality < 1) render();
  };
  const render = () => {
    sun.castShadow = shadows || !moves;
    shapes.light(sun.castShadow);
    resize(moves ? quality : 1);
    camera.position.setFromSpherical(view).applyQuaternion(frame).add(centre);
    camera.lookAt(centre);
    world.updateMatrixWorld();
    shapes.place();
    renderer.render(world, camera);
  };
  let drawn = "";
  const resize = (part) => {
    const [width, height] = [canvas.clientWidth || 800, canvas.clientHeight || 500];
    const ratio = Math.min(devicePixelRatio, software ? 1 : 2) * part;
    if (drawn === `${width} ${height} ${ratio}`) return;
    drawn = `${width} ${height} ${ratio}`;
    renderer.setPixelRatio(ratio);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
  };
  steer(canvas, view, look);
  const observer = new ResizeObserver(look);
  observer.observe(canvas);

  const [p, q] = [new three.Quaternion(), new three.Quaternion()];
  const draw = (time) => {
    const { k, part } = between(run.t, time);
    const next = Math.min(k + 1, run.t.length - 1);
    for (const { group, columns: [x, y, z, w, i, j, l] } of movers) {
      group.position.set(mixed(x, k, next, part), mixed(y, k, next, part), mixed(z, k, next, part));
      p.set(i[k], j[k], l[k], w[k]);
      q.set(i[next], j[next], l[next], w[next]);
      group.quaternion.copy(p.slerp(q, part)).normalize();
    }
    for (const { ends, drawn } of links) drawn.geometry.setFromPoints(ends.map((end) => end()));
    for (const { pin, at } of pins) pin.position.copy(at());
    trails.forEach((trail) => trail.geometry.setDrawRange(0, k + 1));
    for (const { columns, group, drawn } of forces) {
      const force = new three.Vector3(...columns.map((column) => column[k]));
      const length = (0.15 * size * force.length()) / typical;
      if (length > 0.6 * size) force.multiplyScalar((0.6 * size) / length);
      drawn.geometry.setFromPoints([group.position, group.position.clone().addScaledVector(force, (0.15 * size) / typical)]);
    }
    look();
  };
  const dispose = () => {
    observer.disconnect();
    looks = -1;
    clearTimeout(later);
    renderer.dispose();
    renderer.forceContextLoss();
  };
  const legend = forces.length > 0 ? "Red: the force of all contacts on a body, in the mean of a step. " : "";
  return { element: canvas, draw, dispose, hint: `${legend}Drag to turn, wheel or + and - to come nearer.` };
}

// Whether the browser draws WebGL by a processor and not by a graphics card.
function drawsInSoftware() {
  const context = document.createElement("canvas").getContext("webgl2");
  const names = context?.getExtension("WEBGL_debug_renderer_info");
  const name = names ? String(context.getParameter(names.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
}

// Returns the poses of a body whose motion is given: its position as given, or by integration of its velocity; and
// its orientation by integration of its angular velocity.
function givenMotion({ motion, position, orientation }, times, scope) {
  const at = (list, t) => list.map((expression) => value(expression, { t, ...scope }));
  let place = at(position ?? [0, 0, 0], times[0]);
  let turn = at(orientation ?? [1, 0, 0, 0], times[0]);
  const columns = POSE.map(() => []);
  times.forEach((t, k) => {
    const h = k === 0 ? 0 : t - times[k - 1];
    const middle = t - h / 2;
    if (motion.position) place = at(motion.position, t);
    else if (motion.velocity) place = at(motion.velocity, middle).map((v, i) => place[i] + h * v);
    if (motion.angular_velocity) turn = turned(turn, at(motion.angular_velocity, middle), h);
    [...place, ...turn].forEach((one, i) => columns[i].push(one));
  });
  return columns;
}

// Returns the unit quaternion [w, x, y, z] after a rotation with angular velocity `omega` for a time `h`.
function turned([w, x, y, z], omega, h) {
  const rate = Math.hypot(...omega);
  if (rate * h === 0) return [w, x, y, z];
  const [c, s] = [Math.cos((rate * h) / 2), Math.sin((rate * h) / 2) / rate];
  const [a, b, d] = omega.map((one) => one * s);
  return [c * w - a * x - b * y - d * z, c * x + a * w + b * z - d * y, c * y + b * w + d * x - a * z, c * z + d * w + a * y - b * x];
}

// Turns the view of the scene by dragging and by the arrow keys.
function steer(canvas, view, look) {
  const turn = (dx, dy) => {
    view.theta -= dx / 150;
    view.phi = Math.min(3.05, Math.max(0.08, view.phi - dy / 150));
    look();
  };
  const zoom = (factor) => {
    view.radius *= factor;
    look();
  };
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => event.buttons && turn(event.movementX, event.movementY));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(event.deltaY > 0 ? 1.1 : 1 / 1.1);
  });
  const keys = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] };
  canvas.addEventListener("keydown", (event) => {
    if (keys[event.key]) turn(...keys[event.key]);
    else if (event.key === "+") zoom(1 / 1.2);
    else if (event.key === "-") zoom(1.2);
    else return;
    event.preventDefault();
  });
}
