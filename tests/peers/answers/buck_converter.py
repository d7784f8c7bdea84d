"""The buck converter of api/examples/buck_converter.json, from switch to switch.

The switch is closed where cos(2 pi t / T) > cos(pi d): within d T / 2 of every multiple of T. While it is open the diode
conducts until the current of the coil ends. In each mode x' = A x + b, solved by the exponential of a matrix in 30 digits.
Prints the voltage of the capacitor and the current of the coil at the end.
"""

from mpmath import expm, findroot, matrix, mp, mpf

mp.dps = 30
E, L, C, R = mpf(12), mpf("1e-4"), mpf("1e-5"), mpf(2)
T, D, END = mpf("2e-5"), mpf("0.4"), mpf("0.001")


def flow(mode, x, h):
    """The state (v, i, 1) after h: the switch closed, the diode conducting, or neither."""
    source = E / L if mode == "closed" else mpf(0)
    coil = [0, 0, 0] if mode == "open" else [-1 / L, 0, source]
    load = [-1 / (R * C), 0 if mode == "open" else 1 / C, 0]
    return expm(matrix([load, coil, [0, 0, 0]]) * h) * x


def freewheel(x, h):
    after = flow("diode", x, h)
    if after[1] >= 0:
        return after
    ends = findroot(lambda s: flow("diode", x, s)[1], (0, h), solver="anderson")
    x = flow("diode", x, ends)
    x[1] = mpf(0)
    return flow("open", x, h - ends)


if __name__ == "__main__":
    x, t, half, k = matrix([0, 0, 1]), mpf(0), D * T / 2, 0
    while t < END:
        for until, closed in [(k * T + half, True), ((k + 1) * T - half, False), ((k + 1) * T, True)]:
            h = min(until, END) - t
            if h > 0:
                x = flow("closed", x, h) if closed else freewheel(x, h)
                t += h
        k += 1
    print("v(C1)", mp.nstr(x[0], 20))
    print("i(L1)", mp.nstr(x[1], 20))
