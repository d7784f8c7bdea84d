"""SciPy on systems of the examples: solve_ivp with Radau and BDF, smooth or with events at switches.

Called with `--name`, prints a name and version. Otherwise reads {"system", "exact", "tolerances"} from its input and prints
a list of series: {"method", "runs": [{"rtol", "status", "steps", "wall_seconds", "error_at_end"}]}.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import scipy
from scipy.integrate import solve_ivp

EXAMPLES = Path(__file__).resolve().parents[2] / "api" / "examples"
SMOOTH = ["robertson", "van_der_pol", "hires", "pollu"]
REPEATS = 3
FUNCTIONS = {name: getattr(np, name) for name in ("sin", "cos", "exp", "sqrt")} | {"pi": np.pi}


def smooth(document, rtol, method):
    """A system of rates without variables, compiled from its expressions."""
    problem = document["problem"]["dvi"]
    names = list(problem["states"])
    scope = dict(FUNCTIONS)
    for name, value in problem.get("parameters", {}).items():
        scope[name] = eval(str(value), scope)
    rates = [state["rate"] for state in problem["states"].values()]
    body = "[" + ", ".join(str(rate).replace("^", "**") for rate in rates) + "]"
    right = eval(f"lambda t, y: (lambda {', '.join(names)}: {body})(*y)", scope)
    chosen = document["method"]
    atol = chosen["atol"]
    atol = np.array([atol[name] for name in names]) if isinstance(atol, dict) else np.full(len(names), atol)
    atol = atol * rtol / chosen["rtol"]
    start = [state["initial"] for state in problem["states"].values()]
    found = solve_ivp(right, (0, document["time"]["end"]), start, method=method, rtol=rtol, atol=atol)
    return dict(zip(names, found.y[:, -1])), len(found.t) - 1, found.success


def belt(document, rtol, method):
    """The mass on the belt, phase by phase: slipping either way, or sticking until the spring and the damper exceed friction."""
    p, end = document["problem"]["dvi"]["parameters"], document["time"]["end"]
    m, c, k, f, v_belt = (p[name] for name in ("m", "c", "k", "f", "v_belt"))
    state, t, steps, sign = [4.0, 0.0], 0.0, 0, -1.0
    while t < end:
        if sign == 0:
            right = lambda t, y: [v_belt, 0.0]
            event = lambda t, y: abs(k * y[0] + c * v_belt) - f
            event.direction = 1
        else:
            right = lambda t, y, s=sign: [y[1], (-c * y[1] - k * y[0] - s * f) / m]
            event = lambda t, y: y[1] - v_belt
            event.direction = -sign
        event.terminal = True
        found = solve_ivp(right, (t, end), state, method=method, rtol=rtol, atol=rtol, events=event)
        if not found.success:
            return {}, steps, False
        steps += len(found.t) - 1
        t, state = found.t[-1], found.y[:, -1].copy()
        if found.status == 1:
            load = -(k * state[0] + c * v_belt)
            if sign == 0:
                sign = np.sign(load)
                # Beyond the edge, so that the event is not met again at once.
                state[1] += 1e-14 * sign
            else:
                state[1] = v_belt
                sign = 0.0 if abs(load) <= f else np.sign(load)
    return {"x": state[0], "v": state[1]}, steps, True


def series(request, method):
    document = json.loads((EXAMPLES / f"{request['system']}.json").read_text())
    solve = belt if request["system"] == "friction_belt" else smooth
    runs = []
    for rtol in request["tolerances"]:
        times = []
        for _ in range(REPEATS):
            clock = time.perf_counter()
            end, steps, success = solve(document, rtol, method)
            times.append(time.perf_counter() - clock)
        run = {"rtol": rtol, "status": "completed" if success else "failed", "steps": steps, "wall_seconds": sorted(times)[REPEATS // 2],
               "error_at_end": None, "largest_error": None, "order": None}
        if success:
            exact = request["exact"]
            run["error_at_end"] = max(abs(end[name] - value) / (abs(value) or 1.0) for name, value in exact.items())
        runs.append(run)
    events = " with events" if request["system"] == "friction_belt" else ""
    return {"method": f"SciPy {method}{events}", "runs": runs}


if __name__ == "__main__":
    if "--name" in sys.argv:
        print(f"SciPy {scipy.__version__} (Radau, BDF)")
    else:
        request = json.load(sys.stdin)
        known = request["system"] in SMOOTH or request["system"] == "friction_belt"
        print(json.dumps([series(request, method) for method in ("Radau", "BDF")] if known else []))
