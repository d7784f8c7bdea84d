// The gallery of examples by field, each with its equations and two sentences. Further examples of the service are
// under More.

import { element } from "./element.js";

const FIELDS = ["Friction and impact", "Bodies", "Circuits", "Control and switching", "Fields over space", "Queues, traffic and prices", "Stiff and memory", "Fails elsewhere"];

// name: [field, equations, two sentences, the public thread in which another program was reported to fail: title,
// address]
const TEXTS = {
  friction_belt: [0, "m v' = -c v - k x - F,  F in [-f, f],  -(v - v_belt) F maximal", "A mass on a spring rides on a moving belt: it sticks, is torn loose, slips. Turn the speed of the belt and watch stick-slip vanish."],
  bouncing_ball: [0, "m y'' = -m g + r,  0 <= y, r >= 0,  y'+ = -e y'-", "A ball bounces infinitely often in a finite time, then rests. The impacts accumulate, and the solver passes their limit."],
  bouncing_ball_slopes: [0, "dx+ = R_x (dx- + x'- dtau) - x'+ dtau", "The slopes of a bouncing ball by height, gravity and restitution, exact through every impact. They go on behind the limit of the impacts, whose time has slopes of its own."],
  shaken_ball_branch: [0, "0 <= y - a sin 2 pi t,  x(1) = x(0)", "A ball jumps on a shaken table once a period, followed over the amplitude. Where the multiplier passes -1, the jumps become unequal."],
  friction_disk: [0, "m v' = -F,  |F| <= mu m g,  F along v", "A block slides in the plane until friction stops it. Friction is a disk, not a box: the path stays straight."],
  friction_chain: [0, "m x_i'' = k (x_{i+1} - 2 x_i + x_{i-1}) - F_i", "Twenty masses on a rough table are pulled at one end. A wave of slip runs in and dies where friction holds."],
  newton_cradle: [0, "x_i'' = -g/l x_i,  0 <= x_{i+1} - x_i", "Five balls on strings, struck one after the other. Sequential impacts carry the blow through, as the toy does."],
  woodpecker: [0, "M q'' = f(q, q') + W r,  three contacts with friction", "A bird on a sleeve climbs down a pole by impacts and friction alone. It settles to a limit cycle with locking and sliding."],
  rocking_block: [0, "Housner's block: two corners, unilateral and rough", "A block rocks from corner to corner and loses energy at every blow. The period shortens as the amplitude falls."],
  coulomb_slope: [0, "m v' = m g sin - F,  |F| <= mu m g cos", "A block on a slope slides, stops or never starts, by its friction. The solution is a polynomial between its switches, so the method has it exactly."],
  friction_belt_map: [0, "the belt at 7 speeds and 5 frictions", "Where does the mass come to stick? A sweep of 35 members in one table, with the word of modes of each."],
  belt_fit: [0, "minimise the distance to measured x", "Friction and belt speed are found from the measured motion, through stick and slip. The answer has the values and how sure they are."],
  torn_off: [0, "v' = pull t - F,  |F| <= mu", "A body is pulled ever harder until it is torn off. The answer has the time, the work of friction and the slopes by both parameters."],
  rolling_ball: [1, "Newton and Euler, Coulomb's law at the contact", "A sliding ball comes to roll with 5/7 of its speed. Friction acts until the contact point rests."],
  spinning_disc: [1, "(F, tau/R) in mu N L,  L the limit surface of a disc (Contensou)", "A disc slides and spins, and its friction is shared by both. They end together: whatever the start, the ratio v/(R w) draws near to 0.653."],
  rougher_floor: [1, "mu = mu_0 (1 + k x) under each corner", "A block slides along a floor that grows rougher as a spring would stop it. Its front corners bear more of its weight, and meet more friction."],
  elliptic_friction: [1, "(F_x/mu)^2 + (F_y/(c mu))^2 <= N^2", "A puck slides askew on a plate that is rougher across its grain. It loses its speed across it first, v_y ~ v_x^(c^2), and its path bends."],
  heavy_chain: [1, "six bodies, six joints", "A heavy ball swings on a chain of links a thousand times lighter. Ratios of mass like this break most game engines."],
  crank_slider: [1, "hinge, ball, hinge, slider: a closed loop", "A motor turns a crank, a rod drives a piston against a spring. The joints of a loop say some things twice, and hold."],
  shaken_table: [1, "a table with a given motion, a block, a sphere on a spring", "A block rides on a table that shakes, a sphere swings in a wind that grows. It shows given motions, springs and forces."],
  rectifier: [2, "L i' = V sin - R i + v,  0 <= v, i >= 0", "An ideal diode before a resistor and a coil. The current stops, and starts again at the right instant."],
  diode_bridge: [2, "x' = A x + B z,  0 <= z, C x + D z >= 0", "Four ideal diodes across a resonant circuit, as matrices. The classic of complementarity in circuits (Acary and Brogliato)."],
  diode_bridge_dvi: [2, "the same bridge in expressions", "Four diodes as four inequalities. Compare it with the netlist: the answer is the same."],
  diode_bridge_netlist: [2, "C, L, R and four diodes as a netlist", "The same bridge as a SPICE-like netlist. Nodes and components are reduced to the least number of unknowns."],
  diode_bridge_filter: [2, "bridge, filter capacitor, load", "A rectifier with its smoothing capacitor. Diodes conduct in short pulses near the peaks."],
  buck_converter: [2, "switch, ideal diode, coil, load", "A buck converter with ideal switches, no snubbers. Steps land on every switching instant."],
  buck_closed_loop: [2, "PI control, saturation, sawtooth comparator", "A buck converter that regulates itself. The comparator and the limits of the controller are ideal too."],
  buck_orbit: [2, "x(T) = x(0)", "The steady state of a buck converter, found at once. Ripple, means and Floquet multipliers come with it."],
  relay: [3, "x' = 0.3 - s,  s in [-1, 1],  -x s maximal", "A relay drives a state to its switching point, where it stays. Not a chatter: the solution slides."],
  sliding_mode: [3, "x1' = x2, x2' = x1/2 - 2 s", "A switched controller brings its system onto a line and keeps it there. The share `s` is the equivalent control."],
  switching_circle: [3, "x' = f+ outside, f- inside the unit circle", "A rotation that turns round where it crosses the circle. Crossings are located to the last digits."],
  three_regions: [3, "three velocities, regions that meet at a point", "Three regions, each with its own velocity. At the point where they meet all three are mixed, and it rests."],
  reverse_zeno: [3, "a spiral out of a point", "Solutions are not unique here, and the verdict says so. Infinitely many switches lead away from the start."],
  pendulum: [3, "x'' = -x T, y'' = -y T - g,  x x' + y y' = 0", "A pendulum in Cartesian coordinates, an equation of index two. The constraint holds to the tolerance for as long as it runs."],
  obstacle_membrane: [4, "u_t = div grad u,  u >= phi", "A membrane is let down on a hemisphere and comes to rest. The zone of contact is found, not guessed."],
  oxygen_diffusion: [4, "u_t = u_xx - 1,  u >= 0", "Oxygen is consumed in tissue, and the front where it ends runs back. The problem of Crank and Gupta (1972)."],
  american_put: [5, "V_t = (1/2) s^2 V_xx + .., V >= payoff", "An option that may be exercised at any time. The free boundary is the price at which one should."],
  bar_impact: [4, "rho u_tt = E u_xx,  u <= gap at the end", "An elastic bar thrown at a wall and thrown back. It rests on the wall for exactly the time a wave takes to and fro."],
  string_obstacle: [4, "u_tt = u_xx,  u >= 0", "A string is let go above a flat obstacle, which throws it back. Contact nodes bear no mass, so the pressure does not oscillate."],
  viscoelastic_block: [4, "rho u_tt = div(A e(u) + B e(u_t)), Coulomb friction", "A soft block is pressed on a rough floor and pushed along it. Red nodes are in contact."],
  fluid_queue: [5, "q' = arrivals - service + idle, 0 <= q, idle >= 0", "Two queues in tandem: the second gets what the first lets through. Idle capacity is the complementary variable."],
  braess: [5, "0 <= flow, cost >= time, one of them an equality", "Traffic in equilibrium on the network of Braess. The bridge makes everyone slower: take it away and see."],
  nash_cournot: [5, "0 <= q_i, marginal cost >= marginal revenue", "Five firms share one market. No firm gains by another quantity: a variational inequality without time."],
  bottleneck: [5, "departures in equilibrium: costs equal where used", "When do commuters leave home if the road is narrow? Nobody can gain by leaving at another time (Vickrey)."],
  hires: [6, "eight reactions of plant physiology", "A classic of the stiff test set. No inequality at all: `K` is the whole space."],
  pollu: [6, "twenty-five reactions, twenty species", "Air pollution, stiff over six decades. Rates are written as they stand in the paper."],
  robertson: [6, "x' = -0.04 x + 1e4 y z, ...", "Three reactions over eleven decades of time. Look at it on a logarithmic axis."],
  van_der_pol: [6, "eps y' = (1 - x^2) y - x,  eps = 1e-6", "Relaxation oscillations with jumps that take a millionth of the period. An adaptive method of high order does not mind."],
  memory_abel: [6, "0 <= z, integral of (t-s)^(-1/2) z(s) - f >= 0", "What the past has left decides when the variable starts again. The kernel is singular, and its memory never ends."],
  memory_relaxation: [6, "viscoelastic supports with creep kernels", "Two supports push and relax, each no more than it can bear. Their history acts through kernels."],
  chattering_modes: [7, "x' = -2, y' = 3/2 where x > y;  x' = 2, y' = -3 where y > x", "Elsewhere events follow each other at the surface without end, and time stands still. Here the solution slides along it at the rate -6/17 from t = 1/7.", "OpenModelica 12190", "https://github.com/OpenModelica/OpenModelica/issues/12190"],
  charger: [7, "L i' = E - V - R i, then -V - R i until i = 0", "Elsewhere a converter hangs after some hundred switchings. Here 400 periods are solved, and the instant at which the current ends is found in each.", "OpenModelica 14545", "https://github.com/OpenModelica/OpenModelica/issues/14545"],
  held_capsule: [7, "0 <= gap, |friction| <= mu normal: 0.44 N held by up to 16.8 N", "Elsewhere a capsule in a grip creeps down at 50 to 2300 um/s. Here it hangs still, as Coulomb's law says.", "MuJoCo 3328", "https://github.com/google-deepmind/mujoco/issues/3328"],
  sliding_cube: [7, "m v' = -mu m g,  z = 0.05", "Elsewhere a cube launched along a plane lifts off and tumbles. Here it slides 3.67 m and comes to rest on the plane.", "Genesis 3115", "https://github.com/Genesis-Embodied-AI/genesis-world/issues/3115"],
  lost_bounce: [7, "y'' = -g + r,  0 <= y, r >= 0,  y'+ = -y'-", "Elsewhere the sixth impact is missed, and the ball falls through the floor. Here all eight are found, each to the last digits.", "DifferentialEquations.jl 138", "https://github.com/SciML/DifferentialEquations.jl/issues/138"],
  three_roots: [7, "x' = 3 t^2 + 12 t - 4:  roots at -6, -2, 2", "Elsewhere one of three events is found, as a step passes over the other two. Here steps are searched between their ends.", "SciPy 9228", "https://github.com/scipy/scipy/issues/9228"],
  bounce_slope: [7, "y(1) = 5 - y(0):  slope -1", "Elsewhere the height after a bounce jumps as the height before it changes, so that gradients are wrong. Here twenty-one runs lie on one line.", "Brax 317", "https://github.com/google/brax/issues/317"],
};

// Returns the cards of `examples`, {name, title}; `choose(name)` is called with the example that is picked.
export function gallery(examples, choose) {
  const groups = FIELDS.map((field, place) => [field, examples.filter(({ name }) => TEXTS[name]?.[0] === place)]);
  const more = examples.filter(({ name }) => !TEXTS[name]);
  return [...groups, ["More", more]]
    .filter(([, list]) => list.length > 0)
    .flatMap(([field, list]) => [
      element("h2", { class: "part-title" }, field),
      element("ul", { class: "cards" }, ...list.map((example) => element("li", {}, ...card(example, choose)))),
    ]);
}

function card({ name, title }, choose) {
  const [, equations, text, thread, address] = TEXTS[name] ?? [0, "", ""];
  const link = thread ? element("a", { class: "thread", href: address, rel: "noreferrer" }, `Reported: ${thread}`) : null;
  const button = element(
    "button",
    { type: "button", class: "card", "data-example": name, click: () => choose(name) },
    element("canvas", { hidden: true, "aria-hidden": "true" }),
    element("b", {}, title),
    equations ? element("code", {}, equations) : null,
    text ? element("span", {}, text) : null,
  );
  return link ? [button, link] : [button];
}
