"""The block of api/examples/rocking_block.json, between blows in closed equations (Housner 1963).

About the corner that carries it, (4/3) R theta'' = -g sin(alpha - theta), with R the half diagonal and tan alpha = b/h. At
theta = 0 the other corner is struck, and the rate falls to 1 - (3/2) sin(alpha)^2 of itself. Prints the angle at t = 0.7, by
Taylor series in 30 digits.
"""

from mpmath import atan, findroot, mp, mpf, odefun, sin, sqrt

mp.dps = 30
B, H, G, END = mpf("0.1"), mpf("0.4"), mpf("9.81"), mpf("0.7")
RADIUS, ALPHA = sqrt(B**2 + H**2), atan(B / H)


def phase(angle, rate, start):
    """The motion about one corner, the angle counted from rest on both."""
    return odefun(lambda t, y: [y[1], -3 * G / (4 * RADIUS) * sin(ALPHA - y[0])], start, [angle, rate])


if __name__ == "__main__":
    before = phase(ALPHA / 2, mpf(0), mpf(0))
    blow = findroot(lambda t: before(t)[0], mpf("0.3123"))
    after = phase(mpf(0), -before(blow)[1] * (1 - mpf(3) / 2 * sin(ALPHA) ** 2), blow)
    print("blow", mp.nstr(blow, 20))
    print("angle", mp.nstr(-after(END)[0], 20))
