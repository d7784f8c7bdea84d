"""What all peers share: how they are called, and how they are timed.

A peer is a file `*_peer.py` that calls `main` with its name, how to install it, and for each system that it can pose a list of
(method, rungs, prepare). `prepare(request, rung)` builds the model, which is not timed, and returns a function that solves it:
a dictionary with `fields` (by the name of the output the values at `request["times"]`), and, where the program has them,
`steps`, `switches`, `seconds` (its own measurement), and `step` or `rtol` where it was another than asked for. The errors are computed by the report.
"""

import json
import math
import signal
import subprocess
import sys
import time
import warnings

# A division by zero in a solver makes its run fail, and the report shows the failure: no warning
# is needed.
warnings.simplefilter("ignore", RuntimeWarning)

LONG, LONGEST = 0.5, 20  # seconds, as in src/study/report/measure.rs


class Stopped(Exception):
    pass


def stop(*_):
    raise Stopped


def measure(request, method, key, rungs, prepare):
    runs, stopped = [], False
    for rung in rungs:
        if stopped:
            break
        run = {key: rung, "seconds": []}
        signal.setitimer(signal.ITIMER_REAL, 1.5 * LONGEST)
        start = time.perf_counter()
        try:
            solve = prepare(request, rung)
            start = time.perf_counter()
            found = solve()
            first = found.get("seconds", time.perf_counter() - start)
            if first > LONGEST:
                raise Stopped
            if first > LONG:
                run["seconds"].append(first)
            else:
                for _ in range(request["repeats"]):
                    start = time.perf_counter()
                    again = solve()
                    run["seconds"].append(again.get("seconds", time.perf_counter() - start))
            run["steps"] = int(found.get("steps", 0))
            run[key] = found.get(key, rung)  # The program may use another step size or tolerance than requested.
            run["fields"] = {name: [finite(x) for x in values] for name, values in found["fields"].items()}
            run["switches"] = found.get("switches")
        except (Stopped, subprocess.TimeoutExpired):
            run["seconds"], run["message"], stopped = [time.perf_counter() - start], f"stopped after {LONGEST} s", True
        except Exception as error:  # A failed run is marked in the figure; later runs may succeed.
            run["seconds"], run["message"] = [time.perf_counter() - start], f"{type(error).__name__}: {error}"[:200]
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        runs.append(run)
    return {"method": method, "runs": runs}


def finite(x):
    return float(x) if math.isfinite(x) else None


def main(name, install, systems):
    """`name()` fails where the program is not installed; `systems(request)` gives (method, "rtol" or "step", prepare)."""
    if "--install" in sys.argv:
        print(install)
    elif "--name" in sys.argv:
        print(name())
    else:
        name()  # Loads packages before runs are timed.
        signal.signal(signal.SIGALRM, stop)
        request = json.load(sys.stdin)
        ladders = systems(request)
        rungs = {"rtol": request["tolerances"], "step": request["steps"]}
        print(json.dumps([measure(request, method, key, rungs[key], prepare) for method, key, prepare in ladders]))
