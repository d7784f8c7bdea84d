// The picture of what is simulated, by the type of the problem: each is drawn from the specification and a film, an answer at the times
// of frames, by one time cursor.

import * as circuit from "./circuit.js";
import * as phase from "./phase.js";
import * as plane from "./plane.js";
import { elasticMake, elasticNeeds, obstacleMake, obstacleNeeds } from "./profile.js";
import { typeOf } from "../fields.js";
import * as scene from "./scene.js";

const BY_TYPE = {
  rigid_bodies: scene,
  circuit,
  obstacle: { needs: obstacleNeeds, make: obstacleMake },
  elastic: { needs: elasticNeeds, make: elasticMake },
};

// {needs, make} of a specification, nothing where there is no picture of such a problem.
export function pictureOf(specification) {
  if (specification === null || typeof specification !== "object" || !specification.problem) return null;
  // A run that looks for an orbit or a state of rest has a trajectory of its own, which no film of other times shows.
  if (specification.steady_state) return null;
  if (plane.viewOf(specification)) return plane;
  const type = typeOf(specification);
  if (BY_TYPE[type]) return BY_TYPE[type];
  if (type === "mechanical") return plane;
  return phase.statesOf(specification) ? phase : null;
}
