// The pictures of simulated systems, by the type of the problem: each is drawn from the specification and a film at
// the time of one cursor. The script of a picture is fetched when the picture is wanted.

import { typeOf } from "../fields.js";
import { statesOf, viewOf } from "./kinds.js";

const LOADERS = {
  scene: () => import("./scene.js"),
  circuit: () => import("./circuit.js"),
  obstacle: () => import("./profile.js").then(({ obstacleNeeds, obstacleMake }) => ({ needs: obstacleNeeds, make: obstacleMake })),
  elastic: () => import("./profile.js").then(({ elasticNeeds, elasticMake }) => ({ needs: elasticNeeds, make: elasticMake })),
  plane: () => import("./plane.js"),
  phase: () => import("./phase.js"),
};

const BY_TYPE = { rigid_bodies: "scene", circuit: "circuit", obstacle: "obstacle", elastic: "elastic", mechanical: "plane" };

// Returns the name of the picture of a specification, or null if there is no picture of such a problem.
export function pictureOf(specification) {
  if (specification === null || typeof specification !== "object" || !specification.problem) return null;
  // A run that looks for an equilibrium has nothing that moves, and no picture.
  if (specification.steady_state) return null;
  if (viewOf(specification)) return "plane";
  return BY_TYPE[typeOf(specification)] ?? (statesOf(specification) ? "phase" : null);
}

// Fetches the script of a picture, with its functions {needs, make}.
export const load = (name) => LOADERS[name]();
