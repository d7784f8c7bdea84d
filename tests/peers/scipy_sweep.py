"""A sweep of belts by `dvi sweep` and by SciPy, both on all cores, at equal error.

    python3 scipy_sweep.py PROGRAM [MEMBERS] [MEMBERS OF SCIPY]

The members are masses on moving belts over the speed of the belt and its friction, as of `cargo bench --bench sweep`. Errors
are those of position and velocity at the end, against the closed form of each phase: a damped oscillator about a shifted
centre while it slips, a straight line while it sticks; the time of a change is a root of the closed form. Of each method of
SciPy the loosest tolerance is reported at which the root of its mean squared error is no larger than that of `dvi`. SciPy
has fewer members, evenly spread over those of `dvi`, and its time is reported for all.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from multiprocessing import Pool
from pathlib import Path

import numpy as np
import scipy
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

M, C, K, END, START = 1.0, 0.1, 1.0, 20.0, 4.0
METHODS = ["RK45", "DOP853", "Radau", "LSODA"]
TOLERANCES = [10.0**-k for k in range(3, 14)]
# Number of points of a slip phase between which sign changes of the slip velocity are
# searched for: about a hundred per period.
POINTS = 400


def document(members):
    speeds = max(1, math.ceil(members / 25))
    return {
        "problem": {"dvi": {
            "parameters": {"m": M, "c": C, "k": K, "f": 1, "v_belt": 0.5},
            "states": {"x": {"initial": START, "rate": "v"}, "v": {"initial": 0, "rate": "(-c*v - k*x - F)/m"}},
            "variables": {"F": {"inequality": "-(v - v_belt)"}},
            "set": [{"box": {"of": ["F"], "lower": "-f", "upper": "f"}}],
        }},
        "time": {"end": END}, "method": {"rtol": 1e-8},
        "sweep": {"over": {"v_belt": {"linspace": [0.1, 1, speeds]}, "f": {"linspace": [0.2, 1.2, 25]}},
                  "collect": {"x_end": {"final": "x"}, "v_end": {"final": "v"}}},
    }


def slip(state, force):
    """The closed form of a slip under a constant force: x and v as functions of time."""
    centre, decay = force / K, C / (2 * M)
    w = math.sqrt(K / M - decay**2)
    a, b = state[0] - centre, (state[1] + decay * (state[0] - centre)) / w

    def at(t):
        e, cos, sin = math.exp(-decay * t), math.cos(w * t), math.sin(w * t)
        x = a * cos + b * sin
        return centre + e * x, e * (-decay * x + w * (b * cos - a * sin))

    return at


def exact(v_belt, f):
    t, state, sign = 0.0, (START, 0.0), -1.0 if v_belt > 0 else 1.0
    while t < END:
        load = -(K * state[0] + C * v_belt)
        if sign == 0:
            # The mass sticks until the forces of spring and damper exceed the friction.
            leave = t + (f - C * v_belt - K * state[0]) / (K * v_belt)
            if leave >= END:
                return state[0] + v_belt * (END - t), v_belt
            t, state, sign = leave, (state[0] + v_belt * (leave - t), v_belt), -1.0
            continue
        at = slip(state, -sign * f)
        rest = END - t
        relative = lambda s: at(s)[1] - v_belt
        step, end = min(rest, 2 * math.pi / POINTS), None
        before = 1e-9
        while before < rest:
            after = min(before + step, rest)
            if sign * relative(before) > 0 >= sign * relative(after):
                end = brentq(relative, before, after, xtol=1e-15, rtol=4 * np.finfo(float).eps)
                break
            before = after
        if end is None:
            return at(rest)
        t, state = t + end, (at(end)[0], v_belt)
        load = -(K * state[0] + C * v_belt)
        sign = 0.0 if abs(load) <= f else math.copysign(1.0, load)
    return state


def by_scipy(task):
    """One belt, phase by phase, as one writes it with `solve_ivp`."""
    v_belt, f, method, rtol = task
    state, t, sign = [START, 0.0], 0.0, -1.0
    while t < END:
        if sign == 0:
            right = lambda t, y: [v_belt, 0.0]
            event = lambda t, y: abs(K * y[0] + C * v_belt) - f
            event.direction = 1
        else:
            right = lambda t, y, s=sign: [y[1], (-C * y[1] - K * y[0] - s * f) / M]
            event = lambda t, y: y[1] - v_belt
            event.direction = -sign
        event.terminal = True
        found = solve_ivp(right, (t, END), state, method=method, rtol=rtol, atol=rtol, events=event)
        if not found.success:
            return math.nan, math.nan
        t, state = found.t[-1], found.y[:, -1].copy()
        if found.status == 1:
            load = -(K * state[0] + C * v_belt)
            if sign == 0:
                sign = float(np.sign(load))
                # Moves the velocity of the mass slightly beyond the switching surface, so that
                # the event is not detected again at once.
                state[1] += 1e-14 * sign
            else:
                state[1] = v_belt
                sign = 0.0 if abs(load) <= f else float(np.sign(load))
    return state[0], state[1]


def error(found, known):
    return float(np.sqrt(np.mean((np.array(found) - np.array(known)) ** 2)))


def by_dvi(program, members):
    """The seconds that `dvi sweep` takes, and the columns of its table."""
    with tempfile.TemporaryDirectory() as folder:
        specification, table = Path(folder, "belts.json"), Path(folder, "belts.json.out")
        specification.write_text(json.dumps(document(members)))
        clock = time.perf_counter()
        subprocess.run([program, "sweep", specification, "--format", "json", "-o", table], check=True)
        seconds = time.perf_counter() - clock
        return seconds, json.loads(table.read_text())["table"]["columns"]


def main():
    program, members = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 10_000
    few = int(sys.argv[3]) if len(sys.argv) > 3 else 200
    cores = len(os.sched_getaffinity(0))
    seconds, columns = by_dvi(program, members)
    members = len(columns["member"])
    chosen = sorted({round(k * (members - 1) / (few - 1)) for k in range(few)})
    pairs = [(columns["v_belt"][k], columns["f"][k]) for k in chosen]
    known = [exact(*pair) for pair in pairs]
    own = error([(columns["x_end"][k], columns["v_end"][k]) for k in chosen], known)
    print(f"{members} belts, {cores} cores, SciPy {scipy.__version__}")
    print(f"{'':24} {'rtol':>8} {'error':>9} {'seconds':>9} {'ratio':>8}")
    print(f"{'dvi sweep':24} {1e-8:8.0e} {own:9.1e} {seconds:9.2f} {1.0:8.1f}")
    with Pool(cores) as pool:
        for method in METHODS:
            for rtol in TOLERANCES:
                clock = time.perf_counter()
                found = pool.map(by_scipy, [(*pair, method, rtol) for pair in pairs], chunksize=4)
                time_of_all = (time.perf_counter() - clock) * members / len(pairs)
                of_method = error(found, known)
                if of_method <= own:
                    break
            note = "" if of_method <= own else "  (not as exact)"
            print(f"{method:24} {rtol:8.0e} {of_method:9.1e} {time_of_all:9.2f} {time_of_all / seconds:8.1f}{note}")


if __name__ == "__main__":
    main()
