"""The two viscoelastic supports of api/examples/memory_relaxation.json, from switch to switch.

Each exponential kernel is a state: y = int exp(-r (t - s)) z(s) ds has y' = -r y + z. With sines and cosines as states too,
all is x' = A x between switches, where z is 0, 5/2, or what keeps w = 0. Exponentials of A in 40 digits carry x from switch
to switch; these are where z comes to a bound, or w to zero. Prints z at the end.
"""

from itertools import product

from mpmath import expm, findroot, matrix, mp, mpf

mp.dps = 40
COUPLING, TOP, END = mpf(3) / 10, mpf(5) / 2, mpf(9) / 10
STEP = mpf(1) / 64
SMALL, MOMENT = mpf(10) ** -25, mpf(10) ** -8

# States of the linear system that replaces the convolution: the integrals over s from 0 to t of e^{-2(t - s)} z_1,
# e^{-(t - s)} z_2, e^{-(t - s)} z_1 and e^{-2(t - s)} z_2, then sin 2t, cos 2t, sin 3t, cos 3t and 1.
FREE = matrix(9, 9)
for row, column, value in [(0, 0, -2), (1, 1, -1), (2, 2, -1), (3, 3, -2), (4, 5, 2), (5, 4, -2), (6, 7, 3), (7, 6, -3)]:
    FREE[row, column] = value
PUSH = matrix(9, 2)
PUSH[0, 0] = PUSH[2, 0] = PUSH[1, 1] = PUSH[3, 1] = 1
W = matrix([[1, COUPLING, 0, 0, -1, 0, 0, 0, 0], [0, 0, COUPLING, 1, 0, 0, 0, 1, -1]])


def feedback(mode):
    """z = F x where `mode` says of each variable: "zero", "top", or "free" for w' = 0."""
    equations, right = matrix(2, 2), matrix(2, 9)
    slope = W * FREE
    for k, where in enumerate(mode):
        if where == "free":
            equations[k, :] = (W * PUSH)[k, :]
            right[k, :] = -slope[k, :]
        else:
            equations[k, k] = 1
            right[k, 8] = TOP if where == "top" else 0
    return equations**-1 * right


def watched(mode, f, x):
    """What is above zero as long as the mode lasts."""
    z, w = f * x, W * x
    free = [value for k, where in enumerate(mode) if where == "free" for value in (z[k], TOP - z[k])]
    return free + [w[k] if where == "zero" else -w[k] for k, where in enumerate(mode) if where != "free"]


def begins(mode, x):
    """Whether `mode` is that of the next instants: what it rests on holds now, and what it watches a moment later."""
    if any(where == "free" and abs((W * x)[k]) > SMALL for k, where in enumerate(mode)):
        return False
    f = feedback(mode)
    return all(value >= -SMALL for value in watched(mode, f, expm((FREE + PUSH * f) * MOMENT) * x))


def run(end):
    t, x = mpf(0), matrix([0, 0, 0, 0, 0, 1, 0, 1, 1])
    while True:
        modes = [mode for mode in product(("free", "zero", "top"), repeat=2) if begins(mode, x)]
        [mode] = modes
        f = feedback(mode)
        a = FREE + PUSH * f
        print(mp.nstr(t, 15), mode)
        stride, at, state = expm(a * STEP), t, x
        while at < end:
            after = stride * state
            now, then = watched(mode, f, state), watched(mode, f, after)
            met = [k for k in range(len(now)) if then[k] < -SMALL]
            if met:
                break
            at, state = at + STEP, after
        if at >= end:
            return f * (expm(a * (end - t)) * x)
        roots = [findroot(lambda s, k=k: watched(mode, f, expm(a * s) * state)[k], (0, STEP), solver="anderson") for k in met]
        at += min(roots)
        x, t = expm(a * (at - t)) * x, at


if __name__ == "__main__":
    for value in run(END):
        print(mp.nstr(value, 16))
