"""Descriptions of robots as the program reads them, and as MuJoCo does: the same file, the same start, and where each body is after a
while. Contacts and limits are left out, which are soft there and rigid here, and so is what the program leaves out: the inertia of rotors.

MuJoCo has its steps of fourth order (RK4) of 10 us; the program two step sizes, so that its order is seen. Usage: robots.py PROGRAM
"""

import json
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import mujoco
import numpy as np

MODELS = pathlib.Path(__file__).resolve().parents[1] / "systems" / "robots" / "models"
STEP = 1e-5

#: For each robot: its file, the initial position and velocity of joints, the end time, the compared bodies, and the
#: permitted difference at the smaller step size.
RUNS = [
    ("pendulum.urdf", {"theta": (1.2, 0.0)}, 1.0, ["arm"], 1e-7),
    ("double_pendulum.urdf", {"shoulder": (1.1, 0.0), "elbow": (0.6, 1.0)}, 1.0, ["upper", "lower"], 1e-6),
    ("cartpole.urdf", {"slider_to_cart": (0.0, 0.3), "cart_to_pole": (0.2, 0.0)}, 0.8, ["cart", "pole"], 1e-6),
    ("arm.urdf", {"shoulder_lift": (-1.0, 0.5), "elbow": (0.8, 0.0), "wrist_1": (0.3, -1.0)}, 0.5, ["forearm_link", "wrist_1_link", "wrist_3_link"], 1e-5),
    ("double_pendulum.xml", {"slider": (0.0, 0.0), "hinge": (0.1, 0.0), "hinge2": (-0.3, 0.5)}, 0.8, ["cart", "pole", "pole2"], 1e-6),
    ("half_cheetah.xml", {"rootz": (2.0, 0.0), "bthigh": (0.2, 0.0), "ffoot": (-0.2, 1.0)}, 0.3, ["torso", "bfoot", "ffoot"], 2e-5),
    ("hopper.xml", {"rootz": (3.25, 0.0), "thigh_joint": (-0.6, -1.0), "leg_joint": (-0.9, 0.0)}, 0.3, ["torso", "foot"], 2e-5),
    ("humanoid.xml", {"right_knee": (-0.7, 1.0), "left_hip_y": (-0.8, 0.0), "right_elbow": (-0.5, 0.0), "abdomen_y": (-0.2, 0.0)}, 0.2, ["torso", "right_shin", "left_thigh", "right_lower_arm"], 1e-5),
]


def plain(text):
    """Without the inertia of rotors, which the program leaves out and says so, and without limits, which are soft there and hard here."""
    text = re.sub(r'\barmature="[^"]*"', 'armature="0"', text)
    return text.replace('limited="true"', 'limited="false"').replace('autolimits="true"', 'autolimits="false"')


def of_mujoco(path, pose, end, bodies):
    spec = mujoco.MjSpec.from_string(plain(path.read_text()))
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.compiler.balanceinertia = False
    spec.compiler.fusestatic = False
    spec.compiler.discardvisual = False
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, (position, velocity) in pose.items():
        joint = model.joint(name)
        data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = position, velocity
    began = time.perf_counter()
    for _ in range(round(end / STEP)):
        mujoco.mj_step(model, data)
    seconds = time.perf_counter() - began
    mujoco.mj_kinematics(model, data)
    return seconds, {name: data.body(name).xpos.copy() for name in bodies}


def of_program(program, folder, path, pose, end, bodies, step):
    form = "urdf" if path.suffix == ".urdf" else "mjcf"
    text = plain(path.read_text())
    if form == "mjcf":
        text = text.replace("<worldbody>", '<option><flag contact="disable"/></option><worldbody>', 1)
    start = {name: {"position": position, "velocity": velocity} for name, (position, velocity) in pose.items()}
    document = {
        "problem": {"rigid_bodies": {"robot": {form: text, "pose": start}}},
        "time": {"end": end},
        "method": {"step": step},
        "output": {"times": [end], "fields": [f"{name}.{axis}" for name in bodies for axis in "xyz"]},
    }
    file = folder / "robot.json"
    file.write_text(json.dumps(document))
    began = time.perf_counter()
    done = subprocess.run([program, "solve", str(file)], capture_output=True, text=True)
    seconds = time.perf_counter() - began
    assert done.returncode in (0, 7), f"{path.name}: {done.stderr}"
    fields = json.loads(done.stdout)["trajectory"]["fields"]
    return seconds, {name: np.array([fields[f"{name}.{axis}"][-1] for axis in "xyz"]) for name in bodies}


def main(program):
    print(f"MuJoCo {mujoco.__version__}")
    print(f"{'model':24} {'step':>8} {'difference':>11} {'half step':>11} {'order':>6}   MuJoCo     ours  (metres; seconds)")
    failures = []
    with tempfile.TemporaryDirectory() as folder:
        for name, pose, end, bodies, allowed in RUNS:
            path = MODELS / name
            theirs, exact = of_mujoco(path, pose, end, bodies)
            errors = []
            for step in (4e-4, 2e-4):
                ours, found = of_program(program, pathlib.Path(folder), path, pose, end, bodies, step)
                errors.append(max(np.abs(found[body] - exact[body]).max() for body in bodies))
            order = np.log2(errors[0] / errors[1])
            print(f"{name:24} {4e-4:8.0e} {errors[0]:11.2e} {errors[1]:11.2e} {order:6.2f} {theirs:8.2f} {ours:8.2f}")
            if errors[1] > allowed:
                failures.append(name)
    if failures:
        sys.exit(f"not as MuJoCo has it: {', '.join(failures)}")


if __name__ == "__main__":
    main(str(pathlib.Path(sys.argv[1]).resolve()))
