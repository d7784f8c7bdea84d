"""Siconos: Moreau's time stepping and implicit Euler with a complementarity problem, or a relay, at each of the fixed steps."""

from common import main


def name():
    import subprocess

    import siconos.kernel as kernel

    assert kernel
    told = subprocess.run(["dpkg-query", "-W", "-f", "${Version} ", "python3-siconos"], capture_output=True, text=True).stdout
    return f"Siconos {told}(implicit Euler, Moreau)"


def constant(text, p):
    return float(eval(str(text).replace("^", "**"), {}, dict(p)))


def linear(request):
    """A linear complementarity system in matrices."""
    problem = request["specification"]["problem"]["lcs"]
    p = problem.get("parameters", {})
    import numpy as np

    matrix = lambda name: np.array([[constant(entry, p) for entry in row] for row in problem[name]])
    a, b, c = matrix("A"), matrix("B"), matrix("C")
    d = matrix("D") if "D" in problem else None
    initial = np.array([constant(value, p) for value in problem["initial"]])
    return initial, a, None, b, c, d, None, problem["state_names"]


def belt(request):
    import numpy as np

    p = request["specification"]["problem"]["dvi"]["parameters"]
    m, c, k, f, v_belt = (p[name] for name in ("m", "c", "k", "f", "v_belt"))
    a = np.array([[0, 1], [-k / m, -c / m]])
    return np.array([4.0, 0.0]), a, None, np.array([[0], [f / m]]), np.array([[0, 1.0]]), None, np.array([-v_belt]), ["x", "v"]


def sliding(request):
    import numpy as np

    a = np.array([[0, 1.0], [0.5, 0]])
    return np.array([1.0, 0.0]), a, None, np.array([[0], [2.0]]), np.array([[1.0, 1.0]]), None, None, ["x1", "x2"]


FIRST_ORDER = {"diode_bridge": linear, "diode_bridge_filter": linear, "friction_belt": belt, "sliding_mode": sliding}
RELAYS = ("friction_belt", "sliding_mode")


def sample(times, ends, rows, names):
    """Values at the times: of the ends of steps, joined by straight lines."""
    import numpy as np
    table = np.array(rows)
    return {name: np.interp(times, ends, table[:, k]) for k, name in enumerate(names)}


def euler(request, step):
    import numpy as np
    import siconos.kernel as sk
    import siconos.numerics as sn

    end = request["times"][-1]
    initial, a, b0, b, c, d, e, names = FIRST_ORDER[request["system"]](request)
    relay = request["system"] in RELAYS

    def solve():
        states = sk.FirstOrderLinearDS(initial.copy(), a)
        if b0 is not None:
            states.setbPtr(b0)
        relation = sk.FirstOrderLinearTIR(c, b)
        if d is not None:
            relation.setDPtr(d)
        if e is not None:
            relation.setePtr(e)
        law = sk.RelayNSL(1, -1.0, 1.0) if relay else sk.ComplementarityConditionNSL(c.shape[0])
        system = sk.NonSmoothDynamicalSystem(0, end)
        system.insertDynamicalSystem(states)
        system.link(sk.Interaction(law, relation), states)
        problem = sk.Relay(sn.SICONOS_RELAY_LEMKE) if relay else sk.LCP()
        stepping = sk.TimeStepping(system, sk.TimeDiscretisation(0, step), sk.EulerMoreauOSI(1.0), problem)
        rows, ends = [initial.copy()], [0.0]
        # Siconos computes the time as a sum of step sizes: half a step is allowed for rounding at
        # the end time.
        while ends[-1] < end - step / 2:
            stepping.computeOneStep()
            ends.append(ends[-1] + step)
            rows.append(np.array(states.x()))
            stepping.nextStep()
        return {"fields": sample(request["times"], ends, rows, names), "steps": len(ends) - 1}

    return solve


def ball(request, step):
    import numpy as np
    import siconos.kernel as sk

    end = request["times"][-1]
    p = request["specification"]["problem"]["mechanical"]["parameters"]

    def solve():
        body = sk.LagrangianLinearTIDS(np.array([1.0]), np.array([0.0]), np.eye(1) * p["m"])
        body.setFExtPtr(np.array([-p["m"] * p["g"]]))
        system = sk.NonSmoothDynamicalSystem(0, end)
        system.insertDynamicalSystem(body)
        system.link(sk.Interaction(sk.NewtonImpactNSL(p["e"]), sk.LagrangianLinearTIR(np.eye(1))), body)
        stepping = sk.TimeStepping(system, sk.TimeDiscretisation(0, step), sk.MoreauJeanOSI(0.5), sk.LCP())
        rows, ends = [[1.0, 0.0]], [0.0]
        while ends[-1] < end - step / 2:
            stepping.computeOneStep()
            ends.append(ends[-1] + step)
            rows.append([body.q()[0], body.velocity()[0]])
            stepping.nextStep()
        return {"fields": sample(request["times"], ends, rows, ["y", "y_dot"]), "steps": len(ends) - 1}

    return solve


def systems(request):
    if request["system"] in FIRST_ORDER:
        return [("Siconos, implicit Euler", "step", euler)]
    if request["system"] == "bouncing_ball":
        return [("Siconos, Moreau's time stepping", "step", ball)]
    return []


if __name__ == "__main__":
    main(name, "Siconos\ntests/peers/install, or: apt install python3-siconos", systems)
