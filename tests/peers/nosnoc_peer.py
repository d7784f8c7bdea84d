"""nosnoc: finite elements with switch detection (Nurkanovic, Sperl, Albrecht and Diehl 2024) over Radau IIA, a mathematical
program with complementarity constraints in each element by a homotopy of nonlinear programs (CasADi, Ipopt)."""

import contextlib
import io
import warnings

from common import main


def name():
    from importlib.metadata import version

    import nosnoc

    warnings.simplefilter("ignore")
    assert nosnoc
    return f"nosnoc {version('nosnoc')} (FESD)"


def belt(casadi, p):
    x = casadi.SX.sym("x", 2)
    free = (-p["c"] * x[1] - p["k"] * x[0]) / p["m"]
    rates = casadi.horzcat(casadi.vertcat(x[1], free - p["f"] / p["m"]), casadi.vertcat(x[1], free + p["f"] / p["m"]))
    return x, [4.0, 0.0], rates, x[1] - p["v_belt"], ["x", "v"]


def sliding(casadi, p):
    x = casadi.SX.sym("x", 2)
    rates = casadi.horzcat(casadi.vertcat(x[1], x[0] / 2 - 2), casadi.vertcat(x[1], x[0] / 2 + 2))
    return x, [1.0, 0.0], rates, x[0] + x[1], ["x1", "x2"]


def circle(casadi, p):
    import math

    x, w = casadi.SX.sym("x", 2), 2 * math.pi
    rates = casadi.horzcat(casadi.vertcat(x[0] - w * x[1], w * x[0] + x[1]), casadi.vertcat(x[0] + w * x[1], -w * x[0] + x[1]))
    return x, [math.exp(-1), 0.0], rates, 1 - x[0] ** 2 - x[1] ** 2, ["x", "y"]


# For each Filippov system, the first column of its matrix of rates is the vector field where the
# switching function is positive.
SYSTEMS = {"friction_belt": belt, "sliding_mode": sliding, "switching_circle": circle}
ELEMENTS = 2
# Numbers of control intervals of the nosnoc runs: each interval is a nonlinear program of its
# own, which takes tens of milliseconds.
INTERVALS = {0: 10, 1: 20, 2: 40, 3: 80}


def fesd(stages):
    def prepare(request, step):
        import casadi
        import numpy as np
        from nosnoc import NosnocModel, NosnocOpts, NosnocSimLooper, NosnocSolver

        p = next(iter(request["specification"]["problem"].values())).get("parameters", {})
        x, x0, rates, surface, names = SYSTEMS[request["system"]](casadi, p)
        intervals = INTERVALS[request["steps"].index(step)]
        end = request["times"][-1]
        options = NosnocOpts()
        options.n_s, options.N_finite_elements, options.N_stages = stages, ELEMENTS, 1
        options.terminal_time = end / intervals
        options.comp_tol, options.sigma_N, options.print_level = 1e-11, 1e-11, 0
        model = NosnocModel(x=x, F=[rates], S=[np.array([[1], [-1]])], c=[surface], x0=np.array(x0))
        with contextlib.redirect_stdout(io.StringIO()):
            solver = NosnocSolver(options, model)

        def solve():
            with contextlib.redirect_stdout(io.StringIO()):
                looper = NosnocSimLooper(solver, np.array(x0), intervals)
                looper.run()
            found = looper.get_results()
            # nosnoc returns the solution at the ends of finite elements: only the values at
            # the end of the run are compared.
            last = found["X_sim"][-1]
            nothing = [float("nan")] * (len(request["times"]) - 1)
            fields = {name: nothing + [value] for name, value in zip(names, last)}
            # nosnoc does not list the times at which a sliding mode ends: switch times are not
            # compared.
            return {"fields": fields, "steps": len(found["time_steps"]), "step": end / intervals / ELEMENTS}

        return solve

    return prepare


def systems(request):
    if request["system"] not in SYSTEMS:
        return []
    return [(f"nosnoc, FESD, {stages} stages", "step", fesd(stages)) for stages in (2, 3)]


if __name__ == "__main__":
    main(name, "nosnoc\ntests/peers/install, or: python3 -m pip install nosnoc", systems)
