"""The inverter of api/examples/inverter.json, from switch to switch.

The upper switch is closed where the sine exceeds the triangle, else the lower: the load sees E/2 or -E/2, and L i' = u - R i has
a closed form between switches. These are the roots of sine less triangle, one on each of its flanks, in 30 digits. Prints the
current of the coil at the end.
"""

from mpmath import exp, findroot, mp, mpf, pi, sin

mp.dps = 30
E, PERIOD, DEPTH, END = mpf(100), mpf("1e-4"), mpf("0.8"), mpf("0.05")
R, L = mpf(5), mpf("0.01")


def advance(i, u, h):
    return u / R + (i - u / R) * exp(-R / L * h)


if __name__ == "__main__":
    times = []
    for flank in range(2 * int(END / PERIOD)):
        start, way = flank * PERIOD / 2, 1 - 2 * (flank % 2)
        carrier = lambda t: way * (4 * (t - start) / PERIOD - 1)
        times.append(findroot(lambda t: DEPTH * sin(100 * pi * t) - carrier(t), (start, start + PERIOD / 2), solver="anderson"))
    i, t, u = mpf(0), mpf(0), E / 2
    for switch in [*times, END]:
        i, t, u = advance(i, u, switch - t), switch, -u
    print("switches", len(times))
    print("i(L1)", mp.nstr(i, 20))
