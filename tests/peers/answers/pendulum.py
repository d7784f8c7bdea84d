"""The pendulum of api/examples/pendulum.json in Jacobi's elliptic functions.

Released at rest from the horizontal, the angle from the vertical obeys sin(phi/2) = k cd(omega t, k) with k = sin(pi/4) and
omega = sqrt(g). Prints position and velocity at the end, in 30 digits.
"""

from mpmath import asin, cos, diff, ellipfun, mp, mpf, sin, sqrt

mp.dps = 30
G, END = mpf("9.81"), mpf(10)


def angle(t):
    k2 = mpf(1) / 2
    return 2 * asin(sqrt(k2) * ellipfun("cd", sqrt(G) * t, m=k2))


if __name__ == "__main__":
    phi, rate = angle(END), diff(angle, END)
    for name, value in [("x", sin(phi)), ("y", -cos(phi)), ("u", cos(phi) * rate), ("v", sin(phi) * rate)]:
        print(name, mp.nstr(value, 20))
