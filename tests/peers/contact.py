"""Bodies in dry contact, solved by the program and by MuJoCo, Rapier and Bullet, all in one run, on one core and with one step.

Each scene has an exact answer: a body that friction holds with twenty times what it needs does not creep, one that slides over a plane does
not leave it and stops after `v^2/(2 mu g)`, and none is ever within another. The others are run as they come, and as stiff as they can be
made. What is printed is what each differs by from the exact answer, and the time of a step. The program itself has to have the exact answer.

Usage: contact.py PROGRAM
"""

import math
import os
import pathlib
import sys

import numpy as np

import engines

STEP = 0.002  # seconds, the default step size of MuJoCo
G = 9.81
MARGIN = 20  # ratio of the friction limit to the required friction force
SETTLED = 1.0  # seconds after which creep is measured: before, soft contacts settle
SIDE = 0.1
SPEED = 6.0  # initial speed of the sliding cube, in m/s
#: Permitted difference of dvi from the exact solution, in metres, and of the creep in metres per second: 1e-8 of the
#: size of a body. Impulses are solved to about 1e-10 of their size, and their errors accumulate over the steps.
ROUNDING = 1e-8 * SIDE

CUBE = {"name": "cube", "box": [SIDE] * 3, "mass": 1.0, "at": [0, 0, SIDE / 2]}
DOWN = [0, 0, -G]


def slope():
    """A cube at rest on a slope: gravity is turned in place of the ground."""
    angle = math.atan(0.7 / MARGIN)
    return {"gravity": [G * math.sin(angle), 0, -G * math.cos(angle)], "friction": 0.7, "end": 5.0, "bodies": [CUBE], "held": "cube"}


def pushed():
    return {"gravity": DOWN, "friction": 0.7, "end": 5.0, "bodies": [{**CUBE, "force": [0.7 * G / MARGIN, 0, 0]}], "held": "cube"}


def pinched():
    """A capsule between two pads that move along x: both together bear twenty times its weight."""
    radius, size, mass, height = 0.004, [0.02, 0.04, 0.04], 0.045, 0.5
    grip = MARGIN * mass * G / (2 * 0.7)
    reach = radius + size[0] / 2
    bodies = [{"name": "left", "box": size, "mass": 0.1, "at": [-reach, 0, height], "slides": True, "force": [grip, 0, 0]},
              {"name": "right", "box": size, "mass": 0.1, "at": [reach, 0, height], "slides": True, "force": [-grip, 0, 0]},
              {"name": "held", "capsule": [radius, 0.02], "mass": mass, "at": [0, 0, height]}]
    # The pads slide along x, high above the ground, so that their contacts with it are
    # never active.
    return {"gravity": DOWN, "friction": 0.7, "end": 5.0, "bodies": bodies, "held": "held",
            "gaps": [("left", "held", 0, reach), ("held", "right", 0, reach)]}


def sliding():
    return {"gravity": DOWN, "friction": 0.5, "end": 1.6, "bodies": [{**CUBE, "velocity": [SPEED, 0, 0]}], "slides": "cube",
            "distance": SPEED**2 / (2 * 0.5 * G)}


def dropped():
    return {"gravity": DOWN, "friction": 0.5, "end": 1.0, "bodies": [{**CUBE, "at": [0, 0, SIDE / 2 + 0.5]}]}


def stack():
    """Ten cubes, of which the highest has a hundred times the mass of the others."""
    bodies = [{**CUBE, "name": f"cube{k}", "at": [0, 0, (k + 0.5) * SIDE], "mass": 100.0 if k == 9 else 1.0} for k in range(10)]
    return {"gravity": DOWN, "friction": 0.5, "end": 2.0, "bodies": bodies, "held": "cube9",
            "gaps": [(f"cube{k}", f"cube{k + 1}", 2, SIDE) for k in range(9)]}


def pyramid():
    """Ten rows of cubes, a tenth of their size apart, each on two others."""
    bodies, gaps = [], []
    for row in range(10):
        for k in range(10 - row):
            bodies.append({**CUBE, "name": f"c{row}_{k}", "at": [(k + row / 2) * 1.1 * SIDE, 0, (row + 0.5) * SIDE]})
            if row:
                gaps += [(f"c{row - 1}_{k + below}", f"c{row}_{k}", 2, SIDE) for below in (0, 1)]
    return {"gravity": DOWN, "friction": 0.5, "end": 1.5, "bodies": bodies, "held": "c9_0", "gaps": gaps}


SCENES = [("a cube at rest on a slope, friction 20 times what holds it", slope()),
          ("a cube at rest under a force along the ground, friction 20 times what holds it", pushed()),
          ("a capsule pinched by two pads, friction 20 times its weight", pinched()),
          ("a cube that slides to rest on the ground", sliding()),
          ("a cube dropped by half a metre, without restitution", dropped()),
          ("a stack of ten cubes, the highest of a hundred times the mass", stack()),
          ("a pyramid of 55 cubes", pyramid())]


def lowest(places, turns, size):
    """The height of the lowest corner of a box at each time."""
    w, x, y, z = turns.T
    # Half sizes of a box, weighted with the absolute values of the third row of its rotation
    # matrix, give the distance of the lowest corner below the centre.
    row = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])
    return places[:, 2] - np.abs(row).T @ (np.array(size) / 2)


def measure(scene, step, places, turns):
    """Creep in m/s; the largest height over the ground of what slides, the largest penetration, and the error of the distance, in metres."""
    index = {body["name"]: k for k, body in enumerate(scene["bodies"])}
    creep = rise = error = None
    if "held" in scene:
        of, after = places[:, index[scene["held"]]], round(SETTLED / step)
        creep = float(np.linalg.norm(of[-1] - of[after]) / (scene["end"] - SETTLED))
    gaps = [lowest(places[:, k], turns[:, k], body["box"]) for k, body in enumerate(scene["bodies"]) if "box" in body and not body.get("slides")]
    if "slides" in scene:
        rise = float(gaps[0].max())
        error = float(places[-1, index[scene["slides"]], 0] - scene["distance"])
    for one, other, axis, apart in scene.get("gaps", []):
        gaps.append(places[:, index[other], axis] - places[:, index[one], axis] - apart)
    return {"creep": creep, "rise": rise, "depth": float(max(0.0, -min(gap.min() for gap in gaps))), "error": error}


def installed(program):
    """The programs that are here, as they come and stiff."""
    stiff = {"stiff": True}
    others = [(engines.MuJoCo, [{}, stiff, {**stiff, "noslip": 20}]), (engines.Rapier, [{}, stiff, {**stiff, "biased": True}]),
              (engines.Bullet, [{}, stiff])]
    found = [engines.Dvi(program)]
    for engine, settings in others:
        try:
            found += [engine(**setting) for setting in settings]
        except ImportError:
            print(f"left out: {engine.__name__} is not installed")
    return found


def print_row(name, found, last):
    units = {"creep": 1e-6, "rise": 1e-6, "depth": 1e-6, "error": 1e-3}
    cells = [" " * 12 if found[key] is None else f"{found[key] / unit:12.3g}" for key, unit in units.items()]
    print(f"{name:28} {' '.join(cells)} {last}".rstrip(), flush=True)


def main(program):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    programs, failures = installed(program), []
    print("at the ends of steps; the time of dvi counts its second solve, with steps twice as long, by which it judges the first")
    for title, scene in SCENES:
        print(f"\n{title}; {scene['end']:g} s in steps of {STEP * 1e3:g} ms")
        print(f"{'':28} {'creep um/s':>12} {'lift-off um':>12} {'depth um':>12} {'distance mm':>12} {'us a step':>10}")
        for k, engine in enumerate(programs):
            places, turns, seconds = engine.run(scene, STEP)
            found = measure(scene, STEP, places, turns)
            if k == 0:
                print_row("exact", {key: None if value is None else 0.0 for key, value in found.items()}, "")
                # The time stepping of dvi is of first order: the slide may end within the distance that
                # the cube covers in one step.
                allowed = {"creep": ROUNDING, "rise": ROUNDING, "depth": ROUNDING, "error": SPEED * STEP}
                failures += [f"{title}: {key}" for key, value in found.items() if value is not None and not abs(value) <= allowed[key]]
            print_row(engine.name, found, f"{seconds * 1e6:10.1f}")
    if failures:
        sys.exit("not the exact answer: " + "; ".join(failures))


if __name__ == "__main__":
    main(str(pathlib.Path(sys.argv[1]).resolve()))
