"""The viscoelastic block of api/examples/viscoelastic_block.json, on its elements, by implicit Euler in ever shorter steps.

Bilinear elements in plane strain, masses at the nodes, of which those on the floor carry none upwards: it is given to the
node above. Each step from v to w = v + h w',

    (M + h C + h^2 K) w = M v + h (f - K u) + h (N r + T q),    0 <= r perp u_N + h w_N >= 0,    |q| <= 0.3 r against w_T

is reduced to the nodes on the floor, and their states (free, sticking, sliding either way) are changed until all hold.
Errors of first order are extrapolated away. Prints the displacements at the end for two steps, and extrapolated.
"""

import numpy as np
from scipy.linalg import lu_factor, lu_solve

COLUMNS, ROWS, YOUNG, POISSON, VISCOSITY, MU, END = 12, 6, 1000.0, 0.3, 20.0, 0.3, 1.5
LAME = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
SHEAR = YOUNG / (2 * (1 + POISSON))
HX, HY = 2 / COLUMNS, 1 / ROWS
FREE, STICK, FORWARD, BACKWARD = range(4)


def node(i, j):
    return i * (ROWS + 1) + j


def local_stiffness():
    law = np.array([[LAME + 2 * SHEAR, LAME, 0], [LAME, LAME + 2 * SHEAR, 0], [0, 0, SHEAR]])
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    matrix = np.zeros((8, 8))
    for s in (-1 / np.sqrt(3), 1 / np.sqrt(3)):
        for t in (-1 / np.sqrt(3), 1 / np.sqrt(3)):
            strain = np.zeros((3, 8))
            for k, (a, b) in enumerate(corners):
                dx, dy = a * (1 + b * t) / 4 * 2 / HX, b * (1 + a * s) / 4 * 2 / HY
                strain[:, 2 * k : 2 * k + 2] = [[dx, 0], [0, dy], [dy, dx]]
            matrix += strain.T @ law @ strain * HX * HY / 4
    return matrix


def assemble():
    size = 2 * (COLUMNS + 1) * (ROWS + 1)
    stiffness, mass = np.zeros((size, size)), np.zeros(size)
    local = local_stiffness()
    for i in range(COLUMNS):
        for j in range(ROWS):
            nodes = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)]
            places = [2 * n + c for n in nodes for c in (0, 1)]
            stiffness[np.ix_(places, places)] += local
            mass[places] += HX * HY / 4
    floor = [node(i, 0) for i in range(COLUMNS + 1)]
    for n in floor:
        mass[2 * (n + 1) + 1] += mass[2 * n + 1]
        mass[2 * n + 1] = 0
    return stiffness, mass, np.array(floor)


def ends(count, h):
    """Half of the length of an edge at the ends of a side."""
    part = np.full(count, h)
    part[[0, -1]] /= 2
    return part


def run(steps):
    stiffness, mass, floor = assemble()
    size, h = len(mass), END / steps
    damping = VISCOSITY / YOUNG * stiffness
    down, push = np.zeros(size), np.zeros(size)
    down[[2 * node(i, ROWS) + 1 for i in range(COLUMNS + 1)]] = -ends(COLUMNS + 1, HX)
    push[[2 * node(0, j) for j in range(ROWS + 1)]] = ends(ROWS + 1, HY)
    factors = lu_factor(np.diag(mass) + h * damping + h * h * stiffness)
    across, along = 2 * floor + 1, 2 * floor
    both = np.concatenate([across, along])
    forces = np.zeros((size, len(both)))
    forces[both, np.arange(len(both))] = h
    # Velocities of all nodes after one time step for unit contact forces on the floor nodes.
    response_all = lu_solve(factors, forces)
    response = response_all[both]
    count = len(floor)
    u, v, state = np.zeros(size), np.zeros(size), np.full(count, STICK)
    for k in range(steps):
        t = (k + 1) * h
        load = 10 * min(t / 0.2, 1) * down + 8 * max(0, min(t - 0.5, 1)) * push
        w = lu_solve(factors, mass * v + h * (load - stiffness @ u))
        state, reaction = contact(state, w[both], u[across] / h, response, count)
        v = w + response_all @ reaction
        u = u + h * v
    return np.array([u[2 * node(0, ROWS)], u[2 * node(0, ROWS) + 1], u[2 * node(COLUMNS, 0)]])


def contact(state, w, gap, response, count):
    """The states of the nodes and their forces (r, q), for which w_N + gap = 0 or r = 0, and so on."""
    for _ in range(200):
        rows, right = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
        for i, where in enumerate(state):
            if where == FREE:
                rows[i, i] = rows[count + i, count + i] = 1
                continue
            rows[i], right[i] = response[i], -w[i] - gap[i]
            if where == STICK:
                rows[count + i], right[count + i] = response[count + i], -w[count + i]
            else:
                rows[count + i, count + i], rows[count + i, i] = 1, MU if where == FORWARD else -MU
        force = np.linalg.solve(rows, right)
        after = w + response @ force
        r, q, slip = force[:count], force[count:], after[count:]
        new = state.copy()
        for i, where in enumerate(state):
            small = 1e-12
            if where == FREE and after[i] + gap[i] < -small:
                new[i] = STICK
            elif where != FREE and r[i] < -small:
                new[i] = FREE
            elif where == STICK and abs(q[i]) > MU * max(r[i], 0) + small:
                new[i] = BACKWARD if q[i] > 0 else FORWARD
            elif where == FORWARD and slip[i] < -small or where == BACKWARD and slip[i] > small:
                new[i] = STICK
        if (new == state).all():
            return state, force
        state = new
    raise ArithmeticError("no states hold")


if __name__ == "__main__":
    values = []
    for steps in (3000, 6000, 12000, 24000):
        values.append(run(steps))
        print(steps, *values[-1], *(2 * values[-1] - values[-2] if len(values) > 1 else []), flush=True)
