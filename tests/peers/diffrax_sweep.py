"""The sweep of `scipy_sweep.py` by diffrax: all members in one batch of one compiled program.

    python3 diffrax_sweep.py PROGRAM [MEMBERS]

Each belt goes from phase to phase as with SciPy; an event, whose time a root finder corrects, ends a phase. The time is that
of the second call: the first one compiles, and is told apart. Of each method the loosest tolerance is reported at which its
error is no larger than that of `dvi`.
"""

import sys
import time

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from scipy_sweep import END, START, C, K, M, TOLERANCES, by_dvi, error, exact

jax.config.update("jax_enable_x64", True)
METHODS = {"Tsit5": diffrax.Tsit5, "Dopri8": diffrax.Dopri8}
MOST_PHASES = 64


def rates(t, y, args):
    sign, v_belt, f = args
    slips = jnp.array([y[1], (-C * y[1] - K * y[0] - sign * f) / M])
    return jnp.where(sign == 0, jnp.array([v_belt, 0.0]), slips)


def ends(t, y, args, **_):
    """Rises through zero where the phase ends."""
    sign, v_belt, f = args
    return jnp.where(sign == 0, jnp.abs(K * y[0] + C * v_belt) - f, sign * (v_belt - y[1]))


def belt(method, rtol):
    event = diffrax.Event(ends, optimistix.Newton(1e-12, 1e-12), direction=True)
    controller = diffrax.PIDController(rtol=rtol, atol=rtol)

    def phase(carry):
        t, y, sign, count, v_belt, f = carry
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rates), method(), t, END, None, y, (sign, v_belt, f), event=event, max_steps=20_000,
            stepsize_controller=controller, saveat=diffrax.SaveAt(t1=True), throw=False)
        t, y = solution.ts[-1], solution.ys[-1]
        load = -(K * y[0] + C * v_belt)
        after = jnp.where(sign == 0, jnp.sign(load), jnp.where(jnp.abs(load) <= f, 0.0, jnp.sign(load)))
        # Moves the velocity of the mass slightly beyond the switching surface, so that the event
        # is not detected again at once.
        v = jnp.where(sign == 0, y[1] + 1e-14 * after, v_belt)
        y = jnp.where(t < END, jnp.array([y[0], v]), y)
        return t, y, after, count + 1, v_belt, f

    def whole(v_belt, f):
        start = (jnp.asarray(0.0), jnp.array([START, 0.0]), jnp.asarray(-1.0), 0, v_belt, f)
        return jax.lax.while_loop(lambda carry: (carry[0] < END) & (carry[3] < MOST_PHASES), phase, start)[1]

    return jax.jit(jax.vmap(whole))


def main():
    program, members = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 10_000
    seconds, columns = by_dvi(program, members)
    speeds, forces = np.array(columns["v_belt"]), np.array(columns["f"])
    judged = range(0, len(speeds), max(1, len(speeds) // 400))
    known = [exact(speeds[k], forces[k]) for k in judged]
    own = error([(columns["x_end"][k], columns["v_end"][k]) for k in judged], known)
    print(f"{len(speeds)} belts, diffrax {diffrax.__version__}, jax {jax.__version__}")
    print(f"{'':12} {'rtol':>8} {'error':>9} {'seconds':>9} {'compiles':>9} {'ratio':>8}")
    print(f"{'dvi sweep':12} {1e-8:8.0e} {own:9.1e} {seconds:9.2f} {'':9} {1.0:8.1f}", flush=True)
    for name, method in METHODS.items():
        for rtol in TOLERANCES[4:]:
            solve = belt(method, rtol)
            clock = time.perf_counter()
            solve(speeds, forces).block_until_ready()
            first = time.perf_counter() - clock
            clock = time.perf_counter()
            found = np.array(solve(speeds, forces).block_until_ready())
            second = time.perf_counter() - clock
            of_method = error([found[k] for k in judged], known)
            if of_method <= own:
                break
        note = "" if of_method <= own else "  (not as exact)"
        print(f"{name:12} {rtol:8.0e} {of_method:9.1e} {second:9.2f} {first - second:9.2f} {second / seconds:8.1f}{note}", flush=True)


if __name__ == "__main__":
    main()
