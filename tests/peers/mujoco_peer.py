"""MuJoCo on rigid bodies: its contacts are soft by design, as stiff here as it allows (`solref` of two steps, `solimp` to the
limit, elliptic cones); joints are its own coordinates, so that chains and cranks are without constraints."""

import math

from common import main


def name():
    import mujoco

    return f"MuJoCo {mujoco.__version__}"


OPTION = '<option timestep="{h:.17g}" gravity="0 0 -9.81" cone="elliptic" integrator="{integrator}" tolerance="1e-12" iterations="200" impratio="{impratio}"/>'
STIFF = 'solref="{stiff:.17g} 1" solimp="0.9999 0.9999 0.001 0.5 2"'

GROUND = '<geom type="plane" size="50 50 1" friction="{mu} 0 0" condim="3" ' + STIFF + "/>"
ROLLING = ("<mujoco>" + OPTION + "<worldbody>" + GROUND + '<body name="ball" pos="0 0 0.1"><freejoint/><geom type="sphere" size="0.1" '
           'mass="1" friction="0.3 0 0" condim="3" ' + STIFF + "/></body></worldbody></mujoco>")
CUBE = ("<mujoco>" + OPTION + "<worldbody>" + GROUND + '<body name="cube" pos="0 0 0.05"><freejoint/><geom type="box" '
        'size="0.05 0.05 0.05" mass="1" friction="0.5 0 0" condim="3" ' + STIFF + "/></body></worldbody></mujoco>")
PENDULUM = ("<mujoco>" + OPTION + '<worldbody><body><joint name="pivot" type="hinge" axis="0 1 0"/>'
            '<inertial pos="1 0 0" mass="1" diaginertia="1e-12 1e-12 1e-12"/></body></worldbody></mujoco>')


def chain():
    """Five links of a tenth of a metre on ball joints, the last with the ball of a thousand times their mass."""
    open_, close = "", ""
    for k in range(5):
        position = "0 0 0" if k == 0 else "0.1 0 0"
        open_ += (f'<body name="link{k + 1}" pos="{position}"><joint type="ball"/><geom type="capsule" size="0.01 0.035" mass="0.1" '
                  'pos="0.05 0 0" euler="0 90 0" contype="0" conaffinity="0"/>')
        close += "</body>"
    open_ += '<body name="ball" pos="0.1 0 0"><geom type="sphere" size="0.03" mass="100" contype="0" conaffinity="0"/></body>'
    return "<mujoco>" + OPTION + "<worldbody>" + open_ + close + "</worldbody></mujoco>"


PAD = ('<body pos="{place} 0 0"><joint type="slide" axis="1 0 0"/><geom type="box" size="0.01 0.02 0.02" mass="0.1" '
       'friction="0.7 0 0" condim="3" ' + STIFF + "/></body>")
CAPSULE = ("<mujoco>" + OPTION + "<worldbody>" + PAD.replace("{place}", "-0.014") + PAD.replace("{place}", "0.014")
           + '<body name="held" euler="90 0 0"><freejoint/><geom type="capsule" size="0.004 0.01" mass="0.045" friction="0.7 0 0" '
           'condim="3" ' + STIFF + "/></body></worldbody></mujoco>")

MODELS = {"rolling_ball": ROLLING, "heavy_chain": chain(), "pendulum": PENDULUM, "sliding_cube": CUBE, "held_capsule": CAPSULE}
GRIP = 12.0  # force in newtons on each pad that holds the capsule


def outputs(system, model, data):
    import mujoco

    if system == "rolling_ball":
        return {"ball.x": data.qpos[0], "ball.y": data.qpos[1], "ball.z": data.qpos[2], "ball.vx": data.qvel[0],
                "ball.vy": data.qvel[1], "ball.vz": data.qvel[2]}
    if system == "sliding_cube":
        return {"cube.x": data.qpos[0], "cube.y": data.qpos[1], "cube.z": data.qpos[2]}
    if system == "held_capsule":
        return {"held.x": data.qpos[2], "held.y": data.qpos[3], "held.z": data.qpos[4]}
    if system == "pendulum":
        angle, rate = data.qpos[0], data.qvel[0]
        return {"x": math.cos(angle), "y": -math.sin(angle), "u": -math.sin(angle) * rate, "v": -math.cos(angle) * rate}
    ball = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "ball")
    x, y, z = data.xpos[ball]
    return {"ball.x": x, "ball.y": y, "ball.z": z}


def stepping(integrator, impratio):
    def prepare(request, step):
        import mujoco

        system = request["system"]
        text = MODELS[system].format(h=step, stiff=2 * step, integrator=integrator, impratio=impratio, mu=0.3 if system == "rolling_ball" else 0.5)
        model = mujoco.MjModel.from_xml_string(text)
        # The times of comparison are ends of MuJoCo's steps, or lie between two of them, where positions are
        # interpolated linearly.
        times = request["times"]

        def solve():
            data = mujoco.MjData(model)
            if system == "rolling_ball":
                data.qvel[0] = 2.0
            if system == "sliding_cube":
                data.qvel[0] = 6.0
            if system == "held_capsule":
                data.qfrc_applied[:2] = GRIP, -GRIP
            mujoco.mj_forward(model, data)
            rows, at, n, before = [], 0, 0, None
            while at < len(times):
                before = outputs(system, model, data)
                start = n * step
                mujoco.mj_step(model, data)
                # MuJoCo resets an unstable simulation and would continue silently: its warnings
                # are turned into an error.
                if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number or data.warning[mujoco.mjtWarning.mjWARN_BADQPOS].number:
                    raise RuntimeError(f"unstable at t = {n * step:.3g}")
                mujoco.mj_kinematics(model, data)
                n += 1
                after = None
                while at < len(times) and times[at] <= n * step * (1 + 1e-12):
                    after = after or outputs(system, model, data)
                    part = min((times[at] - start) / step, 1.0)
                    rows.append({name: before[name] + part * (after[name] - before[name]) for name in after})
                    at += 1
            return {"fields": {name: [row[name] for row in rows] for name in rows[0]}, "steps": n}

        return solve

    return prepare


def systems(request):
    if request["system"] not in MODELS:
        return []
    if request["system"] in ("rolling_ball", "sliding_cube", "held_capsule"):
        return [("MuJoCo, implicitfast, elliptic", "step", stepping("implicitfast", 10))]
    return [("MuJoCo, RK4", "step", stepping("RK4", 1)), ("MuJoCo, implicitfast", "step", stepping("implicitfast", 1))]


if __name__ == "__main__":
    main(name, "MuJoCo\ntests/peers/install, or: python3 -m pip install mujoco", systems)
