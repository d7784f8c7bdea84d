"""SciPy: solve_ivp with Radau and BDF, analytic Jacobians, and events at switches, from phase to phase."""

import math

from common import main


def name():
    import scipy
    import scipy.integrate

    import smooth  # Checks that SymPy is installed.

    assert smooth
    return f"SciPy {scipy.__version__} (Radau, BDF)"


class Phase:
    """Rates and Jacobian of (t, y), events as (function, direction, next), outputs of (t, y).

    `next(t, y)` gives the phase and the state after the event.
    """

    def __init__(self, rates, events=(), outputs=None, jacobian=None, breaks=()):
        self.rates, self.events, self.outputs, self.jacobian, self.breaks = rates, events, outputs, jacobian, breaks


def follow(phase, state, times, rtol, atol, method, breaks=()):
    """From phase to phase. `breaks` are (time, phase of (t, y)): switches that time alone decides."""
    from scipy.integrate import solve_ivp

    t, rows, steps, switches, at = times[0], [], 0, [], 1
    end, breaks = times[-1], [one for one in breaks if times[0] < one[0] < times[-1]]
    while t < end:
        until = breaks[0][0] if breaks else end
        functions = []
        for function, direction, _ in phase.events:
            event = lambda t, y, function=function: function(t, y)
            event.terminal, event.direction = True, direction
            functions.append(event)
        implicit = phase.jacobian is not None and method != "DOP853"
        jacobian = {"jac": phase.jacobian} if implicit else {}
        found = solve_ivp(phase.rates, (t, until), state, method=method, rtol=rtol, atol=atol, dense_output=True,
                          events=functions or None, **jacobian)
        if not found.success:
            raise RuntimeError(found.message)
        steps += len(found.t) - 1
        t, state = found.t[-1], found.y[:, -1].copy()
        while at < len(times) and (times[at] < t or (times[at] <= t and t >= end)):
            y = found.sol(times[at]) if times[at] < t else state
            rows.append((times[at], y, phase))
            at += 1
        if found.status == 1:
            k = next(k for k, hits in enumerate(found.t_events) if len(hits))
            switches.append(t)
            phase, state = phase.events[k][2](t, state)
        elif breaks and t >= until:
            switches.append(t)
            phase, state = breaks.pop(0)[1](t, state)
    names = rows[-1][2].outputs(*rows[-1][:2]).keys()
    told = [phase.outputs(t, y) for t, y, phase in rows]
    return {"fields": {name: [row.get(name, math.nan) for row in told] for name in names}, "steps": steps, "switches": switches}


def named(*names):
    return lambda t, y: dict(zip(names, y))


def parameters(request):
    return next(iter(request["specification"]["problem"].values())).get("parameters", {})


def belt(p):
    m, c, k, f, v_belt = (p[name] for name in ("m", "c", "k", "f", "v_belt"))

    def slip(s):
        jacobian = [[0, 1], [-k / m, -c / m]]
        event = (lambda t, y: y[1] - v_belt, -s, lambda t, y: arrive(y))
        return Phase(lambda t, y: [y[1], (-c * y[1] - k * y[0] - s * f) / m], [event],
                     lambda t, y: {"x": y[0], "v": y[1], "F": s * f}, jacobian)

    def arrive(y):
        return (stick(), [y[0], v_belt]) if abs(k * y[0] + c * v_belt) <= f else tear(y)

    def tear(y):
        way = math.copysign(1, -(k * y[0] + c * v_belt))
        # Moves the velocity of the mass slightly beyond the switching surface, so that the event
        # is not detected again at once.
        return slip(way), [y[0], v_belt + way * 1e-14]

    def stick():
        event = (lambda t, y: abs(k * y[0] + c * v_belt) - f, 1, lambda t, y: tear(y))
        return Phase(lambda t, y: [v_belt, 0.0], [event],
                     lambda t, y: {"x": y[0], "v": y[1], "F": -(k * y[0] + c * v_belt)}, [[0, 0], [0, 0]])

    return slip(-1.0), [4.0, 0.0]


def torn(p):
    pull, mu = p["pull"], p["mu"]
    told = lambda friction: lambda t, y: {"x": y[0], "v": y[1], "F": friction(t)}
    slide = Phase(lambda t, y: [y[1], pull * t - mu], [], told(lambda t: mu), [[0, 1], [0, 0]])
    rest = Phase(lambda t, y: [0.0, 0.0], [(lambda t, y: pull * t - mu, 1, lambda t, y: (slide, y))], told(lambda t: pull * t),
                 [[0, 0], [0, 0]])
    return rest, [0.0, 0.0]


def rectifier(p):
    volts = lambda t: p["V"] * math.sin(2 * math.pi * p["f"] * t)
    block = Phase(lambda t, y: [0.0], [(lambda t, y: volts(t), 1, lambda t, y: (conduct, y))],
                  lambda t, y: {"i": 0.0, "v_diode": -volts(t)}, [[0.0]])
    conduct = Phase(lambda t, y: [(volts(t) - p["R"] * y[0]) / p["L"]], [(lambda t, y: y[0], -1, lambda t, y: (block, [0.0]))],
                    lambda t, y: {"i": y[0], "v_diode": 0.0}, [[-p["R"] / p["L"]]])
    return conduct, [0.0]


def ball(p):
    g, e = p["g"], p["e"]
    fly = Phase(lambda t, y: [y[1], -g], [(lambda t, y: y[0], -1, lambda t, y: (fly, [0.0, -e * y[1]]))], named("y", "y_dot"),
                [[0, 1], [0, 0]])
    return fly, [1.0, 0.0]


def disk(p):
    g, mu = p["g"], p["mu"]

    def rates(t, y):
        speed = math.hypot(y[2], y[3])
        return [y[2], y[3], -mu * g * y[2] / speed, -mu * g * y[3] / speed]

    rest = Phase(lambda t, y: [0.0] * 4, [], named("x", "y", "vx", "vy"))
    stop = (lambda t, y: 0.6 * y[2] + 0.8 * y[3] - 1e-14, -1, lambda t, y: (rest, [y[0], y[1], 0.0, 0.0]))
    return Phase(rates, [stop], named("x", "y", "vx", "vy")), [0.0, 0.0, 3.0, 4.0]


def sliding(p):
    share = lambda y: (y[1] + y[0] / 2) / 2

    def told(s):
        return lambda t, y: {"x1": y[0], "x2": y[1], "s": s(y)}

    slide = Phase(lambda t, y: [y[1], -y[1]], [], told(share), [[0, 1], [0, -1]])
    reach = (lambda t, y: y[0] + y[1], -1, lambda t, y: (slide, [y[0], -y[0]]))
    return Phase(lambda t, y: [y[1], y[0] / 2 - 2], [reach], told(lambda y: 1.0), [[0, 1], [0.5, 0]]), [1.0, 0.0]


def circle(p):
    omega = 2 * math.pi
    turn = lambda w: (lambda t, y: [y[0] + w * y[1], -w * y[0] + y[1]])
    outside = Phase(turn(omega), [], named("x", "y"), [[1, omega], [-omega, 1]])
    cross = (lambda t, y: y[0] ** 2 + y[1] ** 2 - 1, 1, lambda t, y: (outside, y))
    return Phase(turn(-omega), [cross], named("x", "y"), [[1, -omega], [omega, 1]]), [math.exp(-1), 0.0]


def rocking(p):
    b, h, g = p["b"], p["h"], p["g"]
    radius, alpha = math.hypot(b, h), math.atan(b / h)
    left = 1 - 1.5 * math.sin(alpha) ** 2
    told = lambda s: lambda t, y: {"angle": s * y[0], "angle_dot": s * y[1]}

    def about(s):
        blow = (lambda t, y: y[0], -1, lambda t, y: (about(-s), [0.0, -left * y[1]]))
        return Phase(lambda t, y: [y[1], -0.75 * g / radius * math.sin(alpha - y[0])], [blow], told(s))

    return about(1), [alpha / 2, 0.0]


def rolling(p):
    mu, g, r = 0.3, 9.81, 0.1
    told = named("ball.x", "ball.vx", "ball.wy")
    roll = Phase(lambda t, y: [y[1], 0.0, 0.0], [], told)
    grip = (lambda t, y: y[1] - r * y[2], -1, lambda t, y: (roll, y))
    return Phase(lambda t, y: [y[1], -mu * g, 2.5 * mu * g / r], [grip], told), [0.0, 2.0, 0.0]


def cradle(p):
    stiff = p["g"] / p["l"]
    told = lambda first: lambda t, y: {f"x{k}": y[0] if k == first else 0.0 for k in range(1, 6)}
    jacobian = [[0, 1], [-stiff, 0]]

    def swing(first):
        blow = (lambda t, y: y[0], 1 if first == 1 else -1, lambda t, y: (swing(6 - first), [0.0, y[1]]))
        return Phase(lambda t, y: [y[1], -stiff * y[0]], [blow], told(first), jacobian)

    return swing(1), [-0.05, 0.0]


def bridge_filter(p):
    coil, c, filter_, r = p["L"], p["C"], p["C_filter"], p["R"]
    told = lambda current: lambda t, y: {"v": y[0], "i": y[1], "v_filter": y[2], **current(y)}

    def share(s, y):
        return (s * y[0] / (r * filter_) - s * y[1] / c) / (1 / c + 1 / filter_)

    def conduct(s):
        def rates(t, y):
            i = share(s, y)
            return [-y[1] / c - s * i / c, y[0] / coil, -y[2] / (r * filter_) + i / filter_]

        currents = lambda y: {"i_F1": share(s, y) if s > 0 else 0.0, "i_R1": share(s, y) if s < 0 else 0.0}
        return Phase(rates, [(lambda t, y: share(s, y), -1, lambda t, y: (off, y))], told(currents))

    def on(s):
        return lambda t, y: (conduct(s), [y[0], y[1], s * y[0]])

    meet = [(lambda t, y: y[0] - y[2], 1, on(1)), (lambda t, y: y[0] + y[2], -1, on(-1))]
    off = Phase(lambda t, y: [-y[1] / c, y[0] / coil, -y[2] / (r * filter_)], meet, told(lambda y: {"i_F1": 0.0, "i_R1": 0.0}),
                [[0, -1 / c, 0], [1 / coil, 0, 0], [0, 0, -1 / (r * filter_)]])
    return conduct(1), [100 / 13, 0.0, 100 / 13]


def buck(p):
    volts, coil, c, r = p["E"], 1e-4, 1e-5, 2.0
    told = named("v(C1)", "i(L1)")
    load = [-1 / (r * c), 1 / c]
    driven = lambda u: lambda t, y: [-y[0] / (r * c) + y[1] / c, (u - y[0]) / coil]
    jacobian = [load, [-1 / coil, 0]]
    closed = Phase(driven(volts), [], told, jacobian)
    rest = Phase(lambda t, y: [-y[0] / (r * c), 0.0], [], told, [[load[0], 0], [0, 0]])
    diode = Phase(driven(0.0), [(lambda t, y: y[1], -1, lambda t, y: (rest, [y[0], 0.0]))], told, jacobian)
    return closed, [0.0, 0.0], diode, closed


def spiral(p):
    rates = [[0, -1, 2], [2, 0, -1], [-1, 2, 0]]

    def phase(k):
        leave = (lambda t, y: y[(k + 1) % 3], -1, lambda t, y: (phase((k + 1) % 3), [0.0 if j == (k + 1) % 3 else y[j] for j in range(3)]))
        return Phase(lambda t, y: rates[k], [leave], named("w1", "w2", "w3"), [[0] * 3] * 3)

    return phase(0), [0.0, 1e-6, 0.0]


HYBRID = {
    "friction_belt": belt, "torn_off": torn, "rectifier": rectifier, "bouncing_ball": ball, "friction_disk": disk,
    "sliding_mode": sliding, "switching_circle": circle, "rocking_block": rocking, "rolling_ball": rolling,
    "newton_cradle": cradle, "diode_bridge_filter": bridge_filter, "reverse_zeno": spiral,
}


def hybrid(method):
    def prepare(request, rtol):
        phase, state = HYBRID[request["system"]](parameters(request))
        chosen = request["specification"].get("method", {})
        atol = chosen.get("atol", chosen.get("rtol", 1e-6)) * rtol / chosen.get("rtol", 1e-6)
        start = request["specification"]["time"].get("start", 0.0)
        return lambda: follow(phase, list(state), [start, *request["times"]], rtol, atol, method)

    return prepare


def converter(method):
    def prepare(request, rtol):
        p = parameters(request)
        closed, state, diode, _ = buck(p)
        half, period, end = p["duty"] * p["period"] / 2, p["period"], request["times"][-1]
        breaks = []
        for k in range(int(end / period) + 2):
            breaks.append((k * period + half, lambda t, y: (diode, y)))
            breaks.append(((k + 1) * period - half, lambda t, y: (closed, y)))
        return lambda: follow(closed, list(state), [0.0, *request["times"]], rtol, rtol, method, list(breaks))

    return prepare


def plain(method):
    def prepare(request, rtol):
        import numpy as np
        import sympy
        from scipy.integrate import solve_ivp

        from smooth import Smooth

        system = Smooth(request)
        t = sympy.Symbol("t")
        rates = sympy.lambdify([t, *system.states], system.rates, "math", cse=True)
        jacobian = sympy.lambdify([t, *system.states], system.jacobian.tolist(), "math", cse=True)
        extra = sympy.lambdify([system.states], list(system.extra.values()), "numpy")
        atol = system.tolerances(rtol)

        def solve():
            found = solve_ivp(lambda t, y: rates(t, *y), (0, system.end), system.initial, method=method, rtol=rtol, atol=atol,
                              jac=lambda t, y: np.array(jacobian(t, *y)), dense_output=True)
            if not found.success:
                raise RuntimeError(found.message)
            values = found.sol(np.array(request["times"]))
            values[:, -1] = found.y[:, -1]
            fields = dict(zip(system.names, values)) | dict(zip(system.extra, extra(list(values))))
            return {"fields": fields, "steps": len(found.t) - 1}

        return solve

    return prepare


def systems(request):
    system = request["system"]
    if system in HYBRID:
        return [(f"SciPy {method} with events", "rtol", hybrid(method)) for method in ("Radau", "BDF", "DOP853")]
    if system == "buck_converter":
        return [(f"SciPy {method} with events", "rtol", converter(method)) for method in ("Radau", "DOP853")]
    from smooth import NAMES

    return [(f"SciPy {method}", "rtol", plain(method)) for method in ("Radau", "BDF")] if system in NAMES else []


if __name__ == "__main__":
    main(name, "SciPy\ntests/peers/install, or: python3 -m pip install scipy sympy", systems)
