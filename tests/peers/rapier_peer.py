"""Rapier on rigid bodies, in single precision: with contacts as stiff as the step allows (`engines.py`)."""

from common import main

HEIGHT = 1.0  # height of the capsule above a ground that the example of dvi does not have
GRIP = 12.0  # force in newtons on each pad that holds the capsule

PAD = {"box": [0.02, 0.04, 0.04], "mass": 0.1, "slides": True}
SCENES = {
    "sliding_cube": {"friction": 0.5, "bodies": [{"name": "cube", "box": [0.1] * 3, "mass": 1.0, "at": [0, 0, 0.05], "velocity": [6.0, 0, 0]}]},
    "held_capsule": {"friction": 0.7, "below": HEIGHT, "bodies": [
        {"name": "held", "capsule": [0.004, 0.02], "mass": 0.045, "at": [0, 0, HEIGHT]},
        {**PAD, "name": "left", "at": [-0.014, 0, HEIGHT], "force": [GRIP, 0, 0]},
        {**PAD, "name": "right", "at": [0.014, 0, HEIGHT], "force": [-GRIP, 0, 0]}]},
}


def name():
    from engines import Rapier

    return Rapier().name


def stepping(**settings):
    def prepare(request, step):
        import numpy as np
        from engines import Rapier

        scene = {**SCENES[request["system"]], "gravity": [0, 0, -9.81]}
        build, advance, read = Rapier(**settings).model(scene, step)
        times, steps = request["times"], round(request["times"][-1] / step)
        of = scene["bodies"][0]["name"]

        def solve():
            model = build()
            rows = [read(model)[0][:3]]
            for _ in range(steps):
                advance(model)
                rows.append(read(model)[0][:3])
            # The times of comparison are ends of Rapier's steps, or lie between two of them, where positions are
            # interpolated linearly.
            places = np.array(rows) - [0, 0, scene.get("below", 0.0)]
            return {"fields": {f"{of}.{axis}": np.interp(times, step * np.arange(steps + 1), places[:, k]) for k, axis in enumerate("xyz")},
                    "steps": steps}

        return solve

    return prepare


def systems(request):
    if request["system"] not in SCENES:
        return []
    return [("Rapier", "step", stepping()), ("Rapier, stiff", "step", stepping(stiff=True, biased=True))]


if __name__ == "__main__":
    main(name, "Rapier\ntests/peers/install, or: python3 -m pip install rapier3d", systems)
