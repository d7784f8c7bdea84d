"""Siconos (4.4 and later) on the diode bridge: implicit Euler with a complementarity problem at each of the fixed steps.

Called as its neighbours are. Where Siconos is not installed this fails, and a report goes without it.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import siconos.kernel as sk

EXAMPLES = Path(__file__).resolve().parents[2] / "api" / "examples"
SYSTEM = "diode_bridge"
STEPS = (100, 400, 1600, 6400)
REPEATS = 3


def solve(document, steps):
    problem, end = document["problem"]["lcs"], document["time"]["end"]
    a, b, c, d = (np.array(problem[name], float) for name in "ABCD")
    states = sk.FirstOrderLinearDS(np.array(problem["initial"], float), a)
    relation = sk.FirstOrderLinearTIR(c, b)
    relation.setDPtr(d)
    system = sk.NonSmoothDynamicalSystem(0, end)
    system.insertDynamicalSystem(states)
    system.link(sk.Interaction(sk.ComplementarityConditionNSL(len(d)), relation), states)
    stepping = sk.TimeStepping(system, sk.TimeDiscretisation(0, end / steps), sk.EulerMoreauOSI(1.0), sk.LCP())
    for _ in range(steps):
        stepping.computeOneStep()
        stepping.nextStep()
    return dict(zip(problem["state_names"], np.array(states.x())))


def measure(exact, document, steps):
    times = []
    for _ in range(REPEATS):
        clock = time.perf_counter()
        found = solve(document, steps)
        times.append(time.perf_counter() - clock)
    error = max(abs(found[name] - value) / (abs(value) or 1.0) for name, value in exact.items())
    return {"step": document["time"]["end"] / steps, "status": "completed", "steps": steps, "wall_seconds": sorted(times)[REPEATS // 2],
            "error_at_end": error, "largest_error": None, "order": None}


if __name__ == "__main__":
    if "--name" in sys.argv:
        print("Siconos (implicit Euler)")
    else:
        request = json.load(sys.stdin)
        if request["system"] == SYSTEM:
            document = json.loads((EXAMPLES / f"{SYSTEM}.json").read_text())
            runs = [measure(request["exact"], document, steps) for steps in STEPS]
            print(json.dumps([{"method": "Siconos, implicit Euler", "runs": runs}]))
        else:
            print("[]")
