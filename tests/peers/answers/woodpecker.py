"""The woodpecker of api/examples/woodpecker.json, from event to event (Glocker and Studer 2005).

Between events each contact is open, slides either way or sticks, and all is x' = A x with x = (q, v, 1): exponentials of A
in 30 digits. An event is a gap that closes, a normal force that ends, a slip that ends, or friction at its limit. At an
impact and after each event all modes of the closed contacts are tried; the one whose inequalities hold a moment later is
taken. Impacts obey Newton's law along the normal, and Coulomb's on the impulses. Prints the coordinates at the end.
"""

from itertools import product

from mpmath import expm, findroot, lu_solve, matrix, mp, mpf, sign, zeros

mp.dps = 30
SMALL, MOMENT, STEP, END = mpf(10) ** -20, mpf(10) ** -6, mpf(1) / 2048, mpf(1)
rO, rM, hM, lM, lG, hS, lS, mM, mS, JM, JS, c, g, MU = map(
    mpf, "0.0025 0.0031 0.0058 0.01 0.015 0.02 0.0201 0.0003 0.0045 5e-9 7e-7 0.0056 9.81 0.3".split()
)
M = matrix([[mS + mM, mS * lM, mS * lG], [mS * lM, JM + mS * lM**2, mS * lM * lG], [mS * lG, mS * lM * lG, JS + mS * lG**2]])
FORCE = matrix([[0, 0, 0, 0, 0, 0, -g * (mS + mM)], [0, -c, c, 0, 0, 0, -g * mS * lM], [0, c, -c, 0, 0, 0, -g * mS * lG]])
NORMAL = [matrix([0, 0, -hS]), matrix([0, hM, 0]), matrix([0, -hM, 0])]
TANGENT = [matrix([1, lM, lG - lS]), matrix([1, rM, 0]), matrix([1, rM, 0])]
GAP = [lM + lG - lS - rO, rM - rO, rM - rO]
RESTITUTION = [mpf("0.5"), 0, 0]
OPEN, FORWARD, BACKWARD, STICK = "open", 1, -1, "stick"
WAYS = (OPEN, FORWARD, BACKWARD, STICK)


def dot(a, b):
    return (a.T * b)[0]


def system(mode, right, normal, tangent):
    """M a = right + forces with a . n = normal at closed contacts, and there a . t = tangent where they stick.

    All is linear in as many columns as `right` has. Gives a, and (normal force, tangential force) for each contact.
    """
    closed = [k for k in range(3) if mode[k] != OPEN]
    size, columns = 3 + 2 * len(closed), right.cols
    left, given = zeros(size), zeros(size, columns)
    left[:3, :3], given[:3, :] = M, right
    for row, k in enumerate(closed):
        n, t = 3 + 2 * row, 4 + 2 * row
        left[:3, n], left[:3, t] = -NORMAL[k], -TANGENT[k]
        left[n, :3] = NORMAL[k].T
        given[n, :] = normal[k]
        if mode[k] == STICK:
            left[t, :3] = TANGENT[k].T
            given[t, :] = tangent[k]
        else:
            left[t, t], left[t, n] = 1, MU * mode[k]
    found = left**-1 * given
    forces = [None] * 3
    for row, k in enumerate(closed):
        forces[k] = (found[3 + 2 * row, :], found[4 + 2 * row, :])
    return found[:3, :], forces


def within(way, normal, tangent, slip):
    """What is not below zero at a closed contact."""
    return [normal, MU * normal - tangent, MU * normal + tangent] if way == STICK else [normal, way * slip]


class Mode:
    def __init__(self, mode):
        none = [zeros(1, 7)] * 3
        acceleration, self.forces = system(mode, FORCE, none, none)
        self.mode, self.a = mode, zeros(7)
        for k in range(3):
            self.a[k, 3 + k] = 1
        self.a[3:6, :] = acceleration

    def watched(self, x):
        values = []
        for k, way in enumerate(self.mode):
            if way == OPEN:
                values.append(dot(NORMAL[k], x[:3]) + GAP[k])
            else:
                normal, tangent = (dot(force.T, x) for force in self.forces[k])
                values += within(way, normal, tangent, dot(TANGENT[k], x[3:6]))
        return values


def impact(v):
    """Velocities after, by the first combination of ways that holds at the contacts in `closed`."""

    def holds(mode, after, impulses):
        for k in closed:
            if mode[k] == OPEN:
                if dot(NORMAL[k], after) + RESTITUTION[k] * dot(NORMAL[k], v) < -SMALL:
                    return False
            elif min(within(mode[k], impulses[k][0][0], impulses[k][1][0], dot(TANGENT[k], after))) < -SMALL:
                return False
        return True

    closed = impact.closed
    for ways in product(WAYS, repeat=len(closed)):
        mode = [OPEN] * 3
        for k, way in zip(closed, ways):
            mode[k] = way
        normal = [matrix([[-RESTITUTION[k] * dot(NORMAL[k], v)]]) for k in range(3)]
        after, impulses = system(mode, M * v, normal, [zeros(1)] * 3)
        if holds(mode, after, impulses):
            return after
    raise ArithmeticError("no combination holds")


def next_mode(x):
    closed = [k for k in range(3) if abs(dot(NORMAL[k], x[:3]) + GAP[k]) < SMALL and abs(dot(NORMAL[k], x[3:6])) < SMALL]
    for ways in product(WAYS, repeat=len(closed)):
        ways = dict(zip(closed, ways))
        if any(way == STICK and abs(dot(TANGENT[k], x[3:6])) > SMALL for k, way in ways.items()):
            continue
        mode = Mode([ways.get(k, OPEN) for k in range(3)])
        if min(mode.watched(expm(mode.a * MOMENT) * x)) >= -SMALL:
            return mode
    raise ArithmeticError("no mode holds")


def run(end):
    t, x = mpf(0), matrix([0, -(rM - rO) / hM, mpf("-0.2788"), mpf("-0.3411"), 0, mpf("-7.4583"), 1])
    while True:
        mode = next_mode(x)
        print(mp.nstr(t, 12), mode.mode)
        # The contact mode has been checked over a first interval of length MOMENT: quantities that
        # are zero at its beginning may be negative by rounding at its end.
        x, t = expm(mode.a * MOMENT) * x, t + MOMENT
        stride = expm(mode.a * STEP)
        at, state = t, x
        while at < end:
            after = stride * state
            met = [k for k, value in enumerate(mode.watched(after)) if value < 0]
            if met:
                break
            at, state = at + STEP, after
        roots = []
        if at < end:
            for k in met:
                roots.append(findroot(lambda s: mode.watched(expm(mode.a * s) * state)[k], (0, STEP), solver="anderson", tol=1e-50))
        if at >= end or at + min(roots) >= end:
            return (expm(mode.a * (end - t)) * x)[:6]
        at += min(roots)
        x, t = expm(mode.a * (at - t)) * x, at
        impact.closed = [k for k in range(3) if abs(dot(NORMAL[k], x[:3]) + GAP[k]) < SMALL]
        if any(dot(NORMAL[k], x[3:6]) < -SMALL for k in impact.closed):
            x[3:6] = impact(x[3:6])


if __name__ == "__main__":
    for value in run(END):
        print(mp.nstr(value, 16))
