"""Programs for rigid bodies behind one function: `run(scene, step)` of each engine gives positions and orientations of all bodies at the
ends of steps, and the seconds that a step takes.

A scene has `gravity`, `friction` (of every pair), `end`, and `bodies`, each a dictionary with `name`, `mass`, `at`, and `box` (its sizes) or
`capsule` (radius, length of its straight part, along y), and where it has them `velocity`, `force` (constant, at the centre of mass) and
`slides` (it moves along x only). The ground is the half-space z <= 0. Restitution is zero. No body may fall asleep: that would hide its creep.
"""

import json
import pathlib
import subprocess
import tempfile
import time

import numpy as np

#: The measured time per step is the smallest mean of RUNS runs of an engine, or that of a single run if a run takes
#: longer than `LONG` seconds.
RUNS, LONG = 3, 1.0


def timed(build, advance, read, steps):
    """Steps a model, whose bodies are read at the end of each step, outside of what is timed."""
    seconds = []
    while len(seconds) < RUNS:
        model, spent = build(), 0.0
        rows = [read(model)]
        for _ in range(steps):
            began = time.perf_counter()
            advance(model)
            spent += time.perf_counter() - began
            rows.append(read(model))
        seconds.append(spent / steps)
        if spent > LONG:
            break
    rows = np.array(rows)
    return rows[:, :, :3], rows[:, :, 3:], min(seconds)


class Dvi:
    """The program of this repository. Its own clock is taken, which counts the solve with half as many steps for comparison."""

    def __init__(self, program):
        self.program, self.name = program, "dvi"

    def run(self, scene, step):
        bodies = [{"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": True}]
        joints, forces = [], []
        for body in scene["bodies"]:
            if "box" in body:
                given = {"shape": {"box": {"size": body["box"]}}}
            else:
                half = np.sqrt(0.5)  # Rotates the z axis to the y axis.
                radius, length = body["capsule"]
                given = {"shape": {"capsule": {"radius": radius, "length": length}}, "orientation": [half, half, 0, 0]}
            bodies.append({"name": body["name"], "mass": body["mass"], "position": body["at"], "velocity": body.get("velocity", [0, 0, 0]), **given})
            if body.get("slides"):
                joints.append({"slider": {"name": f"along_{body['name']}", "bodies": [body["name"]], "at": body["at"], "axis": [1, 0, 0]}})
            if "force" in body:
                forces.append({"body": body["name"], "force": body["force"]})
        problem = {"gravity": scene["gravity"], "bodies": bodies, "joints": joints, "forces": forces, "contacts": {"friction": scene["friction"]}}
        document = {"problem": {"rigid_bodies": problem}, "time": {"end": scene["end"]}, "method": {"step": step}}
        steps = round(scene["end"] / step)
        fields = [[f"{body['name']}.{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")] for body in scene["bodies"]]
        document["output"] = {"times": {"count": steps + 1}, "fields": sum(fields, [])}
        answer = self.solve(document)
        columns = answer["trajectory"]["fields"]
        rows = np.array([[columns[name] for name in names] for names in fields]).transpose(2, 0, 1)
        document["output"]["times"] = {"count": 2}
        runs = [answer["diagnostics"]]
        while len(runs) < RUNS and runs[-1]["wall_seconds"] < LONG:
            runs.append(self.solve(document)["diagnostics"])
        return rows[:, :, :3], rows[:, :, 3:], min(run["wall_seconds"] / run["steps"]["accepted"] for run in runs)

    def solve(self, document):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "scene.json"
            file.write_text(json.dumps(document))
            done = subprocess.run([self.program, "solve", str(file)], capture_output=True, text=True)
        assert done.returncode in (0, 7), done.stderr
        return json.loads(done.stdout)


class MuJoCo:
    """MuJoCo with its soft contacts as they come, or as stiff as it allows (`solref` of two steps, `solimp` to the limit, elliptic cones),
    and then with its own remedy for creep, `noslip_iterations`."""

    STIFF = 'solref="{stiff:.17g} 1" solimp="0.9999 0.9999 0.001 0.5 2"'

    def __init__(self, stiff=False, noslip=0):
        import mujoco

        self.mujoco, self.stiff, self.noslip = mujoco, stiff, noslip
        self.name = f"MuJoCo {mujoco.__version__}" + (", stiff" if stiff else "") + (", noslip" if noslip else "")

    def run(self, scene, step):
        mujoco = self.mujoco
        law = f'friction="{scene["friction"]} 0 0" condim="3" ' + (self.STIFF.format(stiff=2 * step) if self.stiff else "")
        texts = [f'<geom type="plane" size="50 50 1" {law}/>']
        for body in scene["bodies"]:
            if "box" in body:
                geom = f'type="box" size="{" ".join(str(size / 2) for size in body["box"])}"'
            else:
                geom = f'type="capsule" euler="90 0 0" size="{body["capsule"][0]} {body["capsule"][1] / 2}"'
            joint = '<joint type="slide" axis="1 0 0"/>' if body.get("slides") else "<freejoint/>"
            place = " ".join(map(str, body["at"]))
            texts.append(f'<body name="{body["name"]}" pos="{place}">{joint}<geom {geom} mass="{body["mass"]}" {law}/></body>')
        elliptic = 'cone="elliptic" impratio="10" iterations="200" tolerance="1e-12" ' if self.stiff else ""
        option = (f'<option timestep="{step:.17g}" gravity="{" ".join(map(str, scene["gravity"]))}" integrator="implicitfast" {elliptic}'
                  f'noslip_iterations="{self.noslip}"/>')
        model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{''.join(texts)}</worldbody></mujoco>")

        def build():
            data = mujoco.MjData(model)
            for body in scene["bodies"]:
                at = model.body(body["name"]).dofadr[0]
                if "velocity" in body:
                    data.qvel[at:at + 3] = body["velocity"]
                if "force" in body:
                    data.xfrc_applied[model.body(body["name"]).id, :3] = body["force"]
            mujoco.mj_forward(model, data)
            return data

        def read(data):
            mujoco.mj_kinematics(model, data)
            return np.hstack([data.xpos[1:], data.xquat[1:]])

        return timed(build, lambda data: mujoco.mj_step(model, data), read, round(scene["end"] / step))


class Rapier:
    """Rapier in single precision, as it comes; or with contacts whose frequency is half of that of the steps, and a hundredth of a millimetre
    of overlap; and then with friction also in its biased pass, against creep. Its friction `COULOMB`, and more iterations, are left as they come:
    with the first a sliding cube went 0.25 m too far, and the second made creep larger."""

    def __init__(self, stiff=False, biased=False):
        import rapier3d

        self.rapier, self.stiff, self.biased = rapier3d, stiff, biased
        self.name = f"Rapier {rapier3d.__version__}" + (", stiff" if stiff else "") + (", biased" if biased else "")

    def run(self, scene, step):
        return timed(*self.model(scene, step), round(scene["end"] / step))

    def model(self, scene, step):
        """How it is built, advanced by a step, and read."""
        rapier = self.rapier

        def build():
            world = rapier.PhysicsWorld(gravity=tuple(scene["gravity"]))
            world.set_num_threads(1)
            parameters = world.integration_parameters
            parameters.dt = step
            if self.stiff:
                parameters.contact_softness = parameters.static_contact_softness = rapier.SpringCoefficients(0.5 / step, 10)
                parameters.normalized_allowed_linear_error = 1e-5
                parameters.friction_in_bias_pass = self.biased
            world.add_collider(rapier.Collider.halfspace((0, 0, 1)).friction(scene["friction"]))
            handles = []
            for body in scene["bodies"]:
                made = rapier.RigidBody.dynamic().translation(tuple(body["at"])).linvel(tuple(body.get("velocity", (0, 0, 0)))).can_sleep(False)
                if body.get("slides"):
                    made = made.enabled_translations((True, False, False)).enabled_rotations((False, False, False))
                if "box" in body:
                    collider = rapier.Collider.cuboid(*(size / 2 for size in body["box"]))
                else:
                    collider = rapier.Collider.capsule_y(body["capsule"][1] / 2, body["capsule"][0])
                handles.append(world.add_body(made, [collider.mass(body["mass"]).friction(scene["friction"])]))
                if "force" in body:  # A force persists until it is removed.
                    world.rigid_bodies[handles[-1]].add_force(tuple(body["force"]))
            return world, handles

        def read(model):
            world, handles = model
            rows = []
            for handle in handles:
                body = world.rigid_bodies[handle]
                x, y, z, w = body.rotation.to_tuple()
                rows.append([*body.translation, w, x, y, z])
            return rows

        return build, lambda model: model[0].step(), read


class Bullet:
    """Bullet in double precision, as it comes; or with four times its iterations and without its tolerance of overlaps. Friction of a pair
    is a product there."""

    def __init__(self, stiff=False):
        import pybullet

        self.bullet, self.stiff = pybullet, stiff
        self.name = f"Bullet {pybullet.getAPIVersion()}" + (", stiff" if stiff else "")

    def run(self, scene, step):
        bullet = self.bullet
        law = {"lateralFriction": float(np.sqrt(scene["friction"])), "restitution": 0, "linearDamping": 0, "angularDamping": 0}

        def build():
            bullet.resetSimulation()
            bullet.setGravity(*scene["gravity"])
            bullet.setTimeStep(step)
            if self.stiff:
                bullet.setPhysicsEngineParameter(numSolverIterations=200, contactSlop=0, solverResidualThreshold=0)
            ground = bullet.createMultiBody(0, bullet.createCollisionShape(bullet.GEOM_PLANE))
            bullet.changeDynamics(ground, -1, **law)
            bodies = []
            for body in scene["bodies"]:
                if "box" in body:
                    shape, turn = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=[size / 2 for size in body["box"]]), [0, 0, 0, 1]
                else:
                    shape = bullet.createCollisionShape(bullet.GEOM_CAPSULE, radius=body["capsule"][0], height=body["capsule"][1])
                    turn = bullet.getQuaternionFromEuler([np.pi / 2, 0, 0])
                if body.get("slides"):
                    rail = {"linkMasses": [body["mass"]], "linkCollisionShapeIndices": [shape], "linkVisualShapeIndices": [-1],
                            "linkPositions": [[0, 0, 0]], "linkOrientations": [[0, 0, 0, 1]], "linkInertialFramePositions": [[0, 0, 0]],
                            "linkInertialFrameOrientations": [[0, 0, 0, 1]], "linkParentIndices": [0], "linkJointAxis": [[1, 0, 0]],
                            "linkJointTypes": [bullet.JOINT_PRISMATIC]}
                    number, link = bullet.createMultiBody(0, basePosition=body["at"], **rail), 0
                    bullet.setJointMotorControl2(number, 0, bullet.VELOCITY_CONTROL, force=0)
                    bullet.changeDynamics(number, 0, jointDamping=0, **law)
                else:
                    number, link = bullet.createMultiBody(body["mass"], shape, basePosition=body["at"], baseOrientation=turn), -1
                    bullet.resetBaseVelocity(number, body.get("velocity", [0, 0, 0]))
                    bullet.changeDynamics(number, -1, **law)
                bodies.append((number, link, body.get("force")))
            return bodies

        def advance(bodies):
            for number, link, force in bodies:
                if force:  # A force acts for one step only.
                    centre = bullet.getLinkState(number, 0)[0] if link == 0 else bullet.getBasePositionAndOrientation(number)[0]
                    bullet.applyExternalForce(number, link, force, centre, bullet.WORLD_FRAME)
            bullet.stepSimulation()

        def read(bodies):
            rows = []
            for number, link, _ in bodies:
                place, (x, y, z, w) = bullet.getLinkState(number, 0)[:2] if link == 0 else bullet.getBasePositionAndOrientation(number)
                rows.append([*place, w, x, y, z])
            return rows

        client = bullet.connect(bullet.DIRECT)
        try:
            return timed(build, advance, read, round(scene["end"] / step))
        finally:
            bullet.disconnect(client)
