"""Closed forms of mechanics in every physics world: ``python benchmarks/experiments.py`` prints three tables.

Each of 31 experiments is a scene in a vertical plane whose outcome is known in closed form: free fall, damping,
sliding, inclined planes, rolling, collisions, bounces, a pendulum, hovering and a limited force. It runs in every world
that has what it takes, and in the bare engine: a program that makes the same bodies with the same settings by calls of
the engine alone. An experiment passes if the error of the world is at most twice that of the bare engine.

The second table is the elasticity of a ball that meets a wall, from 0 to 1, over where within a physics step it meets
it; the third is how fast a crate creeps on a slope that friction should hold it on.

The exit status is 1 if an experiment does not pass. ``--json`` prints figures only; ``--worlds mujoco`` measures only
some worlds.

Sources: R. C. Hibbeler, Engineering Mechanics: Statics, section 8.2 (inclined plane, angle of repose); Dynamics,
sections 14.2 (sliding), 15.4 (restitution), 17.5 (rolling) and 22.1 (pendulum).
"""

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import symaware_cli  # noqa: F401 (before NumPy: it decides which of its kernels are used)

# isort: split
import mujoco
import numpy as np
import pybullet
import pymunk
from numpy.typing import NDArray
from symaware_mujoco.bounce import IMPEDANCE, solref
from symaware_mujoco.scene import MARGIN, NEAR
from symaware_mujoco.world import MujocoEnvironment

from symaware_cli.core import AgentGroup, Entity, Obstacle
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.worlds.physics import PhysicsEnvironment
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

Array = NDArray[np.float64]

GRAVITY = 9.81
TIME_STEP, SUBSTEPS = 0.02, 10
STEP = TIME_STEP / SUBSTEPS
#: Errors below this are rounding: a world need not be within twice of it.
ROUNDING = 1e-6
WORLDS: dict[str, type[PhysicsEnvironment]] = {
    "pymunk": PymunkEnvironment,
    "pybullet": PyBulletEnvironment,
    "mujoco": MujocoEnvironment,
}
SPACE = ("pybullet", "mujoco")

#: A rod of 1 m without mass, with 1 kg at its end, on a hinge at the origin.
SWING, BOB_INERTIA = 0.1, 1e-3
_MOMENTS = "".join(
    f' i{pair}="{moment}"'
    for pair, moment in zip(("xx", "yy", "zz", "xy", "xz", "yz"), (BOB_INERTIA,) * 3 + (0.0,) * 3, strict=True)
)
PENDULUM = f"""<robot name="pendulum">
<link name="base"><inertial><mass value="1"/><inertia{_MOMENTS}/></inertial></link>
<link name="bob"><inertial><origin xyz="0 0 -1"/><mass value="1"/><inertia{_MOMENTS}/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/><origin rpy="0 -{SWING} 0"/>
<axis xyz="0 1 0"/></joint></robot>"""


class Body(NamedTuple):
    """A body in the vertical plane of x and z.

    Attributes:
        size: The radius of a ball, or length and height of a box, which is as wide as long [m].
        place: The position of its centre [m].
        mass: [kg]; None for one that nothing moves.
        velocity: The initial velocity [m/s].
        slope: How steeply its x axis goes down [rad].
        friction: The coefficient, to be multiplied by that of the other body.
        elasticity: To be multiplied as well.
    """

    size: tuple[float, ...]
    place: tuple[float, float]
    mass: float | None = None
    velocity: tuple[float, float] = (0.0, 0.0)
    slope: float = 0.0
    friction: float = 1.0
    elasticity: float = 1.0


@dataclass(frozen=True)
class Trial:
    """A scene.

    Attributes:
        bodies: The bodies by name, in the order of the names.
        duration: How long it runs [s].
        gravity: The acceleration downwards [m/s^2].
        damping: The part of its velocity that a body loses in a second.
        force: The horizontal force on an agent, which is the only body and hovers [N]; None without an agent.
        has_pendulum: Whether the scene is the pendulum alone.
    """

    bodies: Mapping[str, Body] = field(default_factory=dict)
    duration: float = 1.0
    gravity: float = GRAVITY
    damping: float = 0.0
    force: float | None = None
    has_pendulum: bool = False

    @property
    def steps(self) -> int:
        """The number of time steps."""
        return round(self.duration / TIME_STEP)

    def product(self, what: str) -> float:
        """Return the product of a coefficient over the bodies, of which two meet at most."""
        return math.prod(float(getattr(body, what)) for body in self.bodies.values())


#: For each time step and body x, z [m] and their velocities [m/s]; shape (n, m, 4). Those of a pendulum are 0.
Motion = Array


@dataclass(frozen=True)
class Experiment:
    """A trial with a known outcome.

    Attributes:
        name: What it shows.
        trial: The scene.
        measure: Takes the outcome from the motion.
        expected: The closed form.
        unit: The unit of both.
        worlds: The worlds that have what it takes.
        others: The closed form in some worlds if it differs there.
    """

    name: str
    trial: Trial
    measure: Callable[[Motion], float]
    expected: float
    unit: str = "m"
    worlds: Sequence[str] = tuple(WORLDS)
    others: Mapping[str, float] = field(default_factory=dict)

    def error(self, world: str, motion: Motion) -> float:
        """Return how far the outcome of a world is from the closed form."""
        return abs(self.measure(motion) - self.others.get(world, self.expected))


# -- the worlds


def ours(world: str, trial: Trial) -> Motion:
    """Run a trial in a world of SymAware."""
    kind = WORLDS[world]
    planar = world == "pymunk"
    gravity = (0.0, -trial.gravity) if planar else (0.0, 0.0, -trial.gravity)
    more: dict[str, Any] = {} if planar else {"ground": None}
    if planar and trial.has_pendulum:
        joint = {"kind": "pin", "between": ["bob", None], "anchors": [[0, 0], [0, 0]]}
        more["joints"] = {"rod": joint}
    parameters = {"time_step": TIME_STEP, "substeps": SUBSTEPS, "gravity": gravity, "damping": trial.damping, **more}
    environment = kind(kind.Parameters(**parameters))
    obstacles = {name: _obstacle(body, planar) for name, body in trial.bodies.items()}
    nobody = AgentGroup("nobody", ["nobody"], SingleIntegrator(), Entity(), [[99.0, 99.0]])
    groups = [nobody]
    if trial.force is not None:
        groups = [_agent(trial.force, planar)]
        groups[0].control_input = [[1.0, 0.0] if planar else [1.0, 0.0, 0.0]] if trial.force else [[0.0] * (3 - planar)]
    with tempfile.TemporaryDirectory() as folder:
        if trial.has_pendulum:
            obstacles = {"bob": _pendulum(Path(folder), planar)}
        environment.folder = Path(folder)
        environment.initialise(groups, obstacles, 1)
    rows = []
    with environment:
        for _ in range(trial.steps):
            environment.step()
            environment.contacts()
            if trial.force is not None:
                state = environment.state(groups[0])[0]
                rows.append([[state[0], state[1 if planar else 2], 0.0, 0.0]])
            elif trial.has_pendulum and not planar:
                joints = environment.joint_positions("bob")
                assert joints is not None
                rows.append([_swung(float(joints[0, 0]) - SWING)])
            else:
                rows.append([_row(environment, name, planar) for name in obstacles])
    return np.array(rows)


def _obstacle(body: Body, planar: bool) -> Obstacle:
    x, z = body.place
    given: dict[str, Any] = {"mass": body.mass, "friction": body.friction, "elasticity": body.elasticity}
    if body.mass is not None:
        given["velocity"] = list(body.velocity) if planar else [body.velocity[0], 0.0, body.velocity[1]]
    if len(body.size) == 1:
        shape: dict[str, Any] = {"circle": {"radius": body.size[0]}}
    else:
        length, height = body.size
        box = {"length": length, "width": height} if planar else {"length": length, "width": length, "height": height}
        shape = {"box": box}
    if planar:
        return Obstacle(shape=shape, position=[x, z], heading=-body.slope, **given)
    return Obstacle(shape=shape, position=[x, 0.0, z], pitch=body.slope, **given)


def _agent(force: float, planar: bool) -> AgentGroup:
    """An agent of 4 kg that a limited force accelerates to 1 m/s; or one that hovers."""
    dimensions, width = (2, 2) if planar else (3, 3)
    ball = {"circle": {"radius": 0.1}}
    if force:
        pushed = SingleIntegrator(SingleIntegrator.Parameters(dimensions=dimensions))
        return AgentGroup("robot", ["robot"], pushed, Entity(shape=ball, mass=4.0, max_force=force), [[0.0] * width])
    model = DoubleIntegrator(DoubleIntegrator.Parameters(dimensions=dimensions))
    return AgentGroup("robot", ["robot"], model, Entity(shape=ball, mass=4.0), [[0.0] * 2 * width])


def _pendulum(folder: Path, planar: bool) -> Obstacle:
    if planar:
        place = [-math.sin(SWING), -math.cos(SWING)]
        return Obstacle(shape={"circle": {"radius": 1e-3}}, position=place, mass=1.0)
    (folder / "pendulum.urdf").write_text(PENDULUM)
    return Obstacle(shape={"urdf": {"file": "pendulum.urdf", "radius": 1.0}}, position=[0, 0, 0])


def _swung(angle: float) -> list[float]:
    return [math.sin(angle), -math.cos(angle), 0.0, 0.0]


def _row(environment: PhysicsEnvironment, name: str, planar: bool) -> list[float]:
    pose, up = environment.pose(name), 1 if planar else 2
    if not environment.moves(name):
        return [0.0] * 4
    return [pose.position[0], pose.position[up], pose.velocity[0], pose.velocity[up]]


# -- the bare engines, with the settings of the worlds


def bare_pymunk(trial: Trial) -> Motion:
    """Run a trial in Pymunk alone."""
    space, bodies = pymunk.Space(), []
    space.collision_slop, space.damping, space.gravity = 5e-4, 1.0 - trial.damping, (0.0, -trial.gravity)
    if trial.has_pendulum:
        bob = pymunk.Body(1.0, pymunk.moment_for_circle(1.0, 0.0, 1e-3))
        bob.position = -math.sin(SWING), -math.cos(SWING)
        space.add(bob, pymunk.PinJoint(bob, space.static_body))
        bodies = [bob]
    if trial.force is not None:
        robot = pymunk.Body(4.0, float("inf"))
        space.add(robot)
        bodies = [robot]
    for each in trial.bodies.values():
        ball = len(each.size) == 1
        if each.mass is None:
            body = pymunk.Body(body_type=pymunk.Body.STATIC)
        else:
            turning = (
                pymunk.moment_for_circle(each.mass, 0.0, each.size[0])
                if ball
                else pymunk.moment_for_box(each.mass, (each.size[0], each.size[1]))
            )
            body = pymunk.Body(each.mass, turning)
            body.velocity = each.velocity
        body.position, body.angle = each.place, -each.slope
        shape: pymunk.Shape = (
            pymunk.Circle(body, each.size[0]) if ball else pymunk.Poly.create_box(body, (each.size[0], each.size[1]))
        )
        shape.friction, shape.elasticity = each.friction, each.elasticity
        space.add(body, shape)
        bodies.append(body)
    rows = []
    for _ in range(trial.steps):
        for _ in range(SUBSTEPS):
            if trial.force is not None:
                bodies[0].apply_force_at_world_point((trial.force, 4.0 * trial.gravity), bodies[0].position)
            space.step(STEP)
        rows.append([[*body.position, *body.velocity] for body in bodies])
    return np.array(rows)


def bare_pybullet(trial: Trial) -> Motion:
    """Run a trial in PyBullet alone."""
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(STEP, client)
    pybullet.setGravity(0.0, 0.0, -trial.gravity, client)
    pybullet.setPhysicsEngineParameter(
        numSolverIterations=50,
        contactERP=0.02,
        useSplitImpulse=1,
        splitImpulsePenetrationThreshold=0.0,
        restitutionVelocityThreshold=0.01 if trial.gravity else 1e-3,
        contactSlop=1e-5 if trial.gravity else 0.0,
        physicsClientId=client,
    )
    bodies = []
    if trial.has_pendulum:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "pendulum.urdf"
            file.write_text(PENDULUM)
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_IGNORE_VISUAL_SHAPES
            bodies = [pybullet.loadURDF(str(file), useFixedBase=True, flags=flags, physicsClientId=client)]
        for link in (-1, 0):
            pybullet.changeDynamics(bodies[0], link, linearDamping=0, angularDamping=0, physicsClientId=client)
        pybullet.setJointMotorControl2(bodies[0], 0, pybullet.VELOCITY_CONTROL, force=0, physicsClientId=client)
    if trial.force is not None:
        bodies = [pybullet.createMultiBody(4.0, -1, useMaximalCoordinates=1, physicsClientId=client)]
        pybullet.changeDynamics(bodies[0], -1, linearDamping=0, physicsClientId=client)
    for each in trial.bodies.values():
        if len(each.size) == 1:
            shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=each.size[0], physicsClientId=client)
        else:
            half = [0.5 * each.size[0], 0.5 * each.size[0], 0.5 * each.size[1]]
            shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
        turned = (0.0, math.sin(0.5 * each.slope), 0.0, math.cos(0.5 * each.slope))
        place = (each.place[0], 0.0, each.place[1])
        body = pybullet.createMultiBody(
            each.mass or 0.0, shape, -1, place, turned, useMaximalCoordinates=1, physicsClientId=client
        )
        pybullet.changeDynamics(
            body,
            -1,
            lateralFriction=each.friction,
            restitution=each.elasticity,
            linearDamping=trial.damping,
            angularDamping=trial.damping,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            contactProcessingThreshold=0.0,
            physicsClientId=client,
        )
        if each.mass is not None:
            pybullet.resetBaseVelocity(body, (each.velocity[0], 0.0, each.velocity[1]), (0, 0, 0), client)
        bodies.append(body)
    rows = []
    for _ in range(trial.steps):
        for _ in range(SUBSTEPS):
            if trial.force is not None:
                force = (trial.force, 0.0, 4.0 * trial.gravity)
                pybullet.applyExternalForce(bodies[0], -1, force, (0, 0, 0), pybullet.LINK_FRAME, client)
            pybullet.stepSimulation(client)
        if trial.has_pendulum:
            rows.append([_swung(pybullet.getJointState(bodies[0], 0, client)[0] - SWING)])
            continue
        read = []
        for body in bodies:
            (x, _, z), _ = pybullet.getBasePositionAndOrientation(body, client)
            (along, _, upwards), _ = pybullet.getBaseVelocity(body, client)
            read.append([x, z, along, upwards])
        rows.append(read)
    pybullet.disconnect(client)
    return np.array(rows)


def bare_mujoco(trial: Trial) -> Motion:
    """Run a trial in MuJoCo alone, where both surfaces have the product, as it takes the greater coefficient."""
    parts = []
    stiffness, damping = solref(trial.product("elasticity"), STEP)
    contact = (
        f'friction="{max(1e-5, trial.product("friction"))} 0.005 0.0001" solref="{stiffness} {damping}" '
        f'solimp="{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2" margin="{0.5 * MARGIN}" gap="{0.5 * NEAR}"'
    )
    if trial.has_pendulum:
        parts.append(
            f'<body euler="0 {-SWING} 0"><joint axis="0 1 0"/>'
            f'<inertial pos="0 0 -1" mass="1" diaginertia="{BOB_INERTIA} {BOB_INERTIA} {BOB_INERTIA}"/></body>'
        )
    if trial.force is not None:
        slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
        parts.append(f'<body gravcomp="1">{slides}<geom type="sphere" size="0.1" mass="4"/></body>')
    for name, each in trial.bodies.items():
        ball = len(each.size) == 1
        size = each.size[0] if ball else f"{0.5 * each.size[0]} {0.5 * each.size[0]} {0.5 * each.size[1]}"
        geometry = f'<geom type="{"sphere" if ball else "box"}" size="{size}" mass="{each.mass or 0.0}" {contact}/>'
        joint = "" if each.mass is None else f'<freejoint name="{name}"/>'
        turned = f"{math.cos(0.5 * each.slope)} 0 {math.sin(0.5 * each.slope)} 0"
        parts.append(f'<body pos="{each.place[0]} 0 {each.place[1]}" quat="{turned}">{joint}{geometry}</body>')
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option timestep="{STEP}" gravity="0 0 {-trial.gravity}" iterations="100" '
        f'cone="elliptic" impratio="100"/><worldbody>{"".join(parts)}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    free = [name for name, each in trial.bodies.items() if each.mass is not None]
    for number, name in enumerate(free):
        x, z = trial.bodies[name].velocity
        data.qvel[6 * number : 6 * number + 3] = x, 0.0, z
    if trial.force is not None:
        data.qfrc_applied[0] = trial.force
    retained = (1.0 - trial.damping) ** STEP
    rows = []
    for _ in range(trial.steps):
        for _ in range(SUBSTEPS):
            if retained != 1.0:
                data.qvel[:] *= retained
            mujoco.mj_step(model, data)
        if trial.has_pendulum:
            rows.append([_swung(float(data.qpos[0]) - SWING)])
        elif trial.force is not None:
            rows.append([[data.qpos[0], data.qpos[2], 0.0, 0.0]])
        else:
            moving = iter(range(len(free)))
            rows.append(
                [[0.0] * 4 if each.mass is None else _free_row(data, next(moving)) for each in trial.bodies.values()]
            )
    return np.array(rows)


def _free_row(data: Any, number: int) -> list[float]:
    place, velocity = data.qpos[7 * number :], data.qvel[6 * number :]
    return [float(place[0]), float(place[2]), float(velocity[0]), float(velocity[2])]


BARE: dict[str, Callable[[Trial], Motion]] = {
    "pymunk": bare_pymunk,
    "pybullet": bare_pybullet,
    "mujoco": bare_mujoco,
}


# -- the experiments


CRATE, BALL = (0.6, 0.2), (0.25,)
FLOOR = Body((40.0, 0.2), (0.0, -0.1))


def on_slope(angle: float, size: tuple[float, ...], friction: float, duration: float = 2.0) -> Trial:
    """A body that lies on the middle of a ramp."""
    above = 0.1 + (size[0] if len(size) == 1 else 0.5 * size[1])
    place = above * math.sin(angle), above * math.cos(angle)
    ramp = Body((40.0, 0.2), (0.0, 0.0), slope=angle)
    crate = Body(size, place, 2.0, slope=angle, friction=friction, elasticity=0.0)
    return Trial({"a": crate, "b": ramp}, duration)


def experiments() -> Iterator[Experiment]:
    """Yield the 31 experiments."""
    yield Experiment(
        "free fall of a stone that is thrown, depth after 1 s",
        Trial({"a": Body((0.1,), (0.0, 0.0), 2.0, (1.0, 2.0))}),
        lambda motion: float(motion[-1, 0, 1]),
        2.0 - 0.5 * GRAVITY,
    )
    yield Experiment(
        "damping of 0.4, speed after 2 s",
        Trial({"a": Body((0.1,), (0.0, 0.0), 1.0, (3.0, 0.0))}, 2.0, gravity=0.0, damping=0.4),
        lambda motion: float(motion[-1, 0, 2]),
        3.0 * 0.6**2,
        "m/s",
    )
    for friction, speed in ((0.2, 2.0), (0.5, 2.0), (0.8, 3.0), (1.0, 3.0), (0.3, 6.0)):
        crate = Body((0.5, 0.2), (0.0, 0.1), 2.0, (speed, 0.0), friction=friction, elasticity=0.0)
        yield Experiment(
            f"slide with friction {friction} from {speed:g} m/s, distance",
            Trial({"a": crate, "b": FLOOR}, math.ceil(1.5 * speed / (friction * GRAVITY) / TIME_STEP) * TIME_STEP),
            lambda motion: float(motion[-1, 0, 0]),
            speed * speed / (2.0 * friction * GRAVITY),
        )
    for angle in (0.1, 0.3, 0.5):
        for friction in (0.0, 0.2, 0.5):
            yield _incline(f"slope of {angle} rad, friction {friction}", angle, friction)
    for friction in (0.36, 0.37, 0.39, 0.40):
        yield _incline(f"slope whose angle of repose has friction 0.38, friction {friction}", math.atan(0.38), friction)
    rolling = GRAVITY * math.sin(0.3)
    yield Experiment(
        "ball that rolls down 0.3 rad, speed after 1 s",
        on_slope(0.3, BALL, 1.0, 1.0),
        lambda motion: float(np.hypot(*motion[-1, 0, 2:])),
        5.0 / 7.0 * rolling,
        "m/s",
        others={"pymunk": 2.0 / 3.0 * rolling},
    )
    for elasticity, one, other in ((1.0, 1.0, 1.0), (1.0, 1.0, 3.0), (0.5, 2.0, 1.0), (0.0, 1.0, 1.0)):
        bodies = {
            "a": Body((0.1,), (0.0, 0.0), one, (2.0, 0.0), friction=0.0, elasticity=elasticity),
            "b": Body((0.1,), (0.5, 0.0), other, friction=0.0),
        }
        yield Experiment(
            f"collision of {one:g} and {other:g} kg, elasticity {elasticity}, speed of the second",
            Trial(bodies, 0.5, gravity=0.0),
            lambda motion: float(motion[-1, 1, 2]),
            one * (1.0 + elasticity) * 2.0 / (one + other),
            "m/s",
        )
    for elasticity in (0.5, 0.8, 1.0):
        ball = Body((0.1,), (0.0, 1.1), 2.0, elasticity=elasticity)
        fall = math.sqrt(2.0 / GRAVITY)
        yield Experiment(
            f"bounce after a fall of 1 m, elasticity {elasticity}, height",
            Trial({"a": ball, "b": FLOOR}, math.ceil((1.0 + 1.5 * elasticity) * fall / TIME_STEP) * TIME_STEP),
            lambda motion: float(motion[round(1.1 * math.sqrt(2.0 / GRAVITY) / TIME_STEP) :, 0, 1].max()) - 0.1,
            elasticity * elasticity,
        )
    # The first terms of the complete elliptic integral.
    period = 2.0 * math.pi / math.sqrt(GRAVITY) * (1.0 + SWING**2 / 16.0 + 11.0 * SWING**4 / 3072.0)
    yield Experiment(
        "pendulum of 1 m, period",
        Trial(duration=8.2, has_pendulum=True),
        _period,
        period * math.sqrt(1.0 + BOB_INERTIA),
        "s",
        others={"pymunk": period},
    )
    yield Experiment(
        "hovering for 5 s, how far it has moved",
        Trial(duration=5.0, force=0.0),
        lambda motion: float(np.hypot(*motion[-1, 0, :2])),
        0.0,
    )
    yield Experiment(
        "force of 2 N on 4 kg that hover, distance after 1 s",
        Trial(duration=1.0, force=2.0),
        lambda motion: float(motion[-1, 0, 0]),
        0.25,
    )


def _incline(name: str, angle: float, friction: float) -> Experiment:
    trial = on_slope(angle, CRATE, friction)
    start = trial.bodies["a"].place
    acceleration = max(0.0, GRAVITY * (math.sin(angle) - friction * math.cos(angle)))
    return Experiment(
        f"{name}, distance after 2 s",
        trial,
        lambda motion: float(np.hypot(motion[-1, 0, 0] - start[0], motion[-1, 0, 1] - start[1])),
        2.0 * acceleration,
    )


def _period(motion: Motion) -> float:
    x = motion[:, 0, 0]
    before = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossings = before + x[before] / (x[before] - x[before + 1])
    return float(np.diff(crossings).mean()) * TIME_STEP


# -- elasticity and creep


def bounces(world: str, elasticity: float, run: Callable[[Trial], Motion], phases: int = 8) -> tuple[float, float]:
    """Return the least and the greatest part of its speed of 2 m/s that a ball has after it met a wall."""
    found = []
    for phase in range(phases):
        gap = (20 + (phase + 0.5) / phases) * 2.0 * STEP
        bodies = {
            "a": Body((0.2,), (-0.3 - gap, 0.0), 1.0, (2.0, 0.0), friction=0.0, elasticity=elasticity),
            "b": Body((0.2, 0.2), (0.0, 0.0), friction=0.0),
        }
        found.append(-float(run(Trial(bodies, 0.3, gravity=0.0))[-1, 0, 2]) / 2.0)
    return min(found), max(found)


def creep(run: Callable[[Trial], Motion], friction: float) -> float:
    """Return how fast a crate creeps on a slope of 0.3 rad, from 2 to 10 s [mm/s]."""
    motion = run(on_slope(0.3, CRATE, friction, 10.0))
    early, late = motion[round(2.0 / TIME_STEP) - 1, 0, :2], motion[-1, 0, :2]
    return float(np.hypot(*(late - early))) / 8.0 * 1e3


# -- tables


@cache
def _runs(world: str) -> tuple[Callable[[Trial], Motion], Callable[[Trial], Motion]]:
    return lambda trial: ours(world, trial), BARE[world]


def measured(worlds: Sequence[str]) -> Iterator[tuple[Experiment, dict[str, tuple[float, float]]]]:
    """Yield each experiment, and by world its error and that of the bare engine."""
    for experiment in experiments():
        found = {}
        for world in worlds:
            if world in experiment.worlds:
                own, bare = (experiment.error(world, run(experiment.trial)) for run in _runs(world))
                found[world] = own, bare
        yield experiment, found


def passes(own: float, bare: float) -> bool:
    """Return whether an error is within twice that of the bare engine, or rounding."""
    return own <= 2.0 * bare + ROUNDING


def _line(experiment: Experiment, found: Mapping[str, tuple[float, float]], worlds: Sequence[str]) -> str:
    cells = []
    for world in worlds:
        if world in found:
            own, bare = found[world]
            cells.append(f"{own:.2g}; {bare:.2g}{'' if passes(own, bare) else ' **missed**'}")
        else:
            cells.append("")
    return f"| {experiment.name} | {experiment.expected:.4g} {experiment.unit} | {' | '.join(cells)} |"


def main() -> int:
    """Measure and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS), choices=list(WORLDS))
    parser.add_argument("--json", action="store_true", help="print figures only")
    arguments = parser.parse_args()
    worlds, missed, count = arguments.worlds, 0, 0
    figures: dict[str, Any] = {"experiments": {}, "elasticity": {}, "creep": {}}

    def show(line: str) -> None:
        if not arguments.json:
            print(line, flush=True)

    show(f"| experiment | closed form | {' | '.join(f'{world}: error; bare engine' for world in worlds)} |")
    show("|---|---:|" + "---:|" * len(worlds))
    for experiment, found in measured(worlds):
        show(_line(experiment, found, worlds))
        figures["experiments"][experiment.name] = found
        missed += sum(not passes(*errors) for errors in found.values())
        count += 1
    show(f"\n{count} experiments, {missed} errors of more than twice the bare engine's.\n")
    show(f"| elasticity | {' | '.join(f'{world}: least to greatest' for world in worlds)} |")
    show("|---:|" + "---:|" * len(worlds))
    for elasticity in np.linspace(0.0, 1.0, 11).round(2).tolist():
        cells = {world: bounces(world, elasticity, _runs(world)[0]) for world in worlds}
        figures["elasticity"][elasticity] = cells
        show(f"| {elasticity} | {' | '.join(f'{low:.3f} to {high:.3f}' for low, high in cells.values())} |")
    show(f"\n| friction on a slope of 0.3 rad (tangent 0.309) | {' | '.join(f'{world} [mm/s]' for world in worlds)} |")
    show("|---:|" + "---:|" * len(worlds))
    for friction in (0.32, 0.4, 0.5, 1.0):
        speeds = {world: creep(_runs(world)[0], friction) for world in worlds}
        figures["creep"][friction] = speeds
        show(f"| {friction} | {' | '.join(f'{speed:.2g}' for speed in speeds.values())} |")
    if arguments.json:
        print(json.dumps(figures))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
