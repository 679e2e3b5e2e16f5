"""Benchmark of the physics worlds against their bare engines: ``python benchmarks/worlds.py`` prints a table.

Every figure is a ratio of the CPU times of two programs, measured in turn, round after round; the median and the range
over the rounds are shown. The bare engine does what a program written for it would do: the same bodies and surfaces in
the same order, the same engine settings, motors set once per time step, and poses and velocities read once per time
step. Both must end with bit-identical positions, or the benchmark stops. Only driven bodies may differ: the bare loop
applies their forces one by one in each physics step.

SymAware always detects every contact, with its point and its impulse, as scenarios require. There are thus two fair
comparisons: with a program that needs no contacts, to which the target applies; and with one that reads them in each
physics step, as the manual of the engine describes, since a bounce begins and ends between two time steps.

Whole runs are of a scenario file with only such bodies, or with one distant agent, from reading the file to closing the
log; they are compared with the bare loop, including the creation of its bodies. SymAware reads the positions of free
bodies only if they are needed; the bare loop always reads them. A recorded log has all of them at each time step, and
ends with the same positions.
"""

import argparse
import json
import math
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import symaware_cli  # noqa: F401 (before NumPy: it decides which of its kernels are used)

# isort: split
import numpy as np
import pybullet
import pybullet_data
import pymunk
import yaml
from numpy.typing import ArrayLike, NDArray
from pymunk import batch

from symaware_cli import open_log
from symaware_cli.core import AgentGroup, Entity, Obstacle
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.engine.models.racecar import TRACK, WHEEL_RADIUS, WHEELBASE, Racecar, hinge_angles
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.worlds import bullet_collisions as collisions
from symaware_cli.worlds.bullet_vehicles import MARGIN
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

Array = NDArray[np.float64]
Measured = tuple[float, Array | None]

TIME_STEP, SUBSTEPS = 0.05, 10
#: [m] The radius of a wheel with the engine's margin.
WHEEL = round(WHEEL_RADIUS + MARGIN, 9)
RADIUS = 0.3
CIRCLE = {"circle": {"radius": RADIUS}}
#: Engine settings that the worlds use.
ENGINE = {
    "numSolverIterations": 50,
    "contactERP": 0.02,
    "useSplitImpulse": 1,
    "splitImpulsePenetrationThreshold": 0.0,
}
WEIGHTLESS = {"restitutionVelocityThreshold": 1e-3, "contactSlop": 0.0}
HEAVY = {"restitutionVelocityThreshold": 0.01, "contactSlop": 1e-5}
FAR_AWAY = [-10.0, -10.0]
#: Number of time steps of whole runs: 200 s.
WHOLE = 4000
#: gym-pybullet-drones 2: 10 drones with PID at 48 Hz, physics at 240 Hz; agent-steps of the controller per CPU-second.
PEER_DRONES = 3000


def places(count: int, crowded: bool) -> tuple[Array, Array]:
    """Return positions on a square grid, and velocities: outwards, or all towards the centre."""
    side = math.ceil(math.sqrt(count))
    spacing = 0.7 if crowded else 5.0
    grid = np.array([[row % side, row // side] for row in range(count)], float) * spacing
    away = grid - grid.mean(axis=0)
    direction = away / np.maximum(np.linalg.norm(away, axis=1), 1e-9)[:, None]
    return grid, -0.3 * direction if crowded else 0.1 * direction


def stepped(
    environment: PymunkEnvironment | PyBulletEnvironment, group: AgentGroup, control_input: ArrayLike | None, steps: int
) -> float:
    """Return the CPU time of some steps of a SymAware world: states and velocities of all bodies, and contacts."""
    if control_input is not None:
        group.control_input = control_input
    started = time.process_time()
    for _ in range(steps):
        environment.step()
        environment.contacts()
        if environment.obstacles:
            environment.entity_poses(list(environment.obstacles))
    return time.process_time() - started


def our_circles(
    kind: type[PymunkEnvironment | PyBulletEnvironment], count: int, crowded: bool, driven: bool, steps: int
) -> Measured:
    """Measure circles that track a velocity, or move freely, with a distant agent, since a run needs one."""
    grid, velocity = places(count, crowded)
    space = {} if kind is PymunkEnvironment else {"ground": None, "gravity": (0, 0, 0)}
    environment = kind(kind.Parameters(time_step=TIME_STEP, substeps=SUBSTEPS, **space))
    robots = AgentGroup("robot", [f"{n}" for n in range(count)], SingleIntegrator(), Entity(shape=CIRCLE), grid)
    nobody = AgentGroup("nobody", ["nobody"], SingleIntegrator(), Entity(), [FAR_AWAY])
    free = {
        f"b{n:03}": Obstacle(shape=CIRCLE, mass=1.0, position=grid[n].tolist(), velocity=velocity[n].tolist())
        for n in range(count)
    }
    environment.initialise([robots if driven else nobody], {} if driven else free, 1)
    used = stepped(environment, robots, velocity if driven else None, steps)
    ends = None if driven else np.array([environment.pose(name).position[:2] for name in free])
    environment.close()
    return used, ends


def bare_pymunk(count: int, crowded: bool, driven: bool, steps: int, contacts: bool) -> Measured:
    """Measure Pymunk alone; driven bodies are moved by one force per body and physics step."""
    grid, velocity = places(count, crowded)
    space, bodies, step = pymunk.Space(), [], TIME_STEP / SUBSTEPS
    space.collision_slop = 5e-4
    if not driven:
        nobody = pymunk.Body(1.0, float("inf"))
        nobody.position = FAR_AWAY[0], FAR_AWAY[1]
        space.add(nobody)
    for position, own in zip(grid.tolist(), velocity.tolist(), strict=True):
        body = pymunk.Body(1.0, float("inf") if driven else pymunk.moment_for_circle(1.0, 0.0, RADIUS))
        body.position, body.velocity = tuple(position), (0.0, 0.0) if driven else tuple(own)
        shape = pymunk.Circle(body, RADIUS)
        shape.friction = 0.5
        space.add(body, shape)
        bodies.append(body)
    news: list[tuple[Any, ...]] = []

    def meet(arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        if arbiter.is_first_contact:
            found = arbiter.contact_point_set
            news.append((*arbiter.shapes, found.points[0].point_a, arbiter.total_impulse))

    def part(arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        news.append(arbiter.shapes)

    if contacts:
        space.on_collision(post_solve=meet, separate=part)
    wanted, buffer = [tuple(own) for own in velocity.tolist()], batch.Buffer()
    fields = batch.BodyFields.POSITION | batch.BodyFields.ANGLE | batch.BodyFields.VELOCITY
    fields |= batch.BodyFields.ANGULAR_VELOCITY
    started = time.process_time()
    for _ in range(steps):
        news.clear()
        for _ in range(SUBSTEPS):
            if driven:
                for body, (x, y) in zip(bodies, wanted, strict=True):
                    now = body.velocity
                    body.apply_force_at_world_point(((x - now[0]) / step, (y - now[1]) / step), body.position)
            space.step(step)
        buffer.clear()
        batch.get_space_bodies(space, fields, buffer)
        read = np.frombuffer(buffer.float_buf()).reshape(-1, 6).copy()
    return time.process_time() - started, None if driven else read[1:, :2]


def taken_contacts(
    client: int, touching: Mapping[tuple[int, int], Any], news: list[tuple[Any, ...]], step: float
) -> dict[tuple[int, int], Any]:
    """Read contacts from PyBullet, record those that began, with point and impulse, or ended, and return them."""
    found = {each[1:3]: each for each in pybullet.getContactPoints(physicsClientId=client) if each[8] <= 0}
    news += [(*pair, each[5], each[9] * step) for pair, each in found.items() if pair not in touching]
    news += [pair for pair in touching if pair not in found]
    return found


def bare_pybullet(count: int, crowded: bool, driven: bool, steps: int, contacts: bool) -> Measured:
    """Measure PyBullet alone, likewise."""
    grid, velocity = places(count, crowded)
    client, step = pybullet.connect(pybullet.DIRECT), TIME_STEP / SUBSTEPS
    pybullet.setTimeStep(step, client)
    pybullet.setPhysicsEngineParameter(**ENGINE, **WEIGHTLESS, physicsClientId=client)
    if not driven:
        pybullet.createMultiBody(1.0, -1, -1, (*FAR_AWAY, 0), useMaximalCoordinates=1, physicsClientId=client)
    shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=RADIUS, physicsClientId=client)
    bodies = []
    for (x, y), own in zip(grid.tolist(), velocity.tolist(), strict=True):
        body = pybullet.createMultiBody(1.0, shape, -1, (x, y, 0), useMaximalCoordinates=1, physicsClientId=client)
        pybullet.changeDynamics(
            body,
            -1,
            linearDamping=0,
            angularDamping=0,
            lateralFriction=0.5,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            contactProcessingThreshold=0.0,
            physicsClientId=client,
        )
        if not driven:
            pybullet.resetBaseVelocity(body, (*own, 0.0), (0, 0, 0), client)
        bodies.append(body)
    pybullet.performCollisionDetection(client)  # as SymAware, which checks for overlaps at the start
    wanted = [(*own, 0.0) for own in velocity.tolist()]
    touching: dict[tuple[int, int], Any] = {}
    news: list[tuple[Any, ...]] = []
    started = time.process_time()
    for _ in range(steps):
        news.clear()
        for _ in range(SUBSTEPS):
            if driven:
                for body, aim in zip(bodies, wanted, strict=True):
                    now, _ = pybullet.getBaseVelocity(body, client)
                    force = [(to - by) / step for to, by in zip(aim, now, strict=True)]
                    pybullet.applyExternalForce(body, -1, force, (0, 0, 0), pybullet.LINK_FRAME, client)
            pybullet.stepSimulation(client)
            if contacts:
                touching = taken_contacts(client, touching, news, step)
        read: list[Any] = []
        for body in bodies:
            read += (*pybullet.getBasePositionAndOrientation(body, client), *pybullet.getBaseVelocity(body, client))
    used = time.process_time() - started
    pybullet.disconnect(client)
    return used, None if driven else np.array([position[:2] for position in read[::4]])


def our_cars(count: int, steps: int) -> Measured:
    """Measure racecars with wheels, and return their final positions."""
    environment = PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=TIME_STEP, substeps=SUBSTEPS))
    states = [[0.0, 2.0 * row, 0.0, 0.0, 0.0] for row in range(count)]
    cars = AgentGroup("car", [f"car{row}" for row in range(count)], Racecar(), Entity(), states)
    environment.initialise([cars], {}, 1)
    with environment:
        return stepped(environment, cars, [[1.0, 0.1]] * count, steps), environment.state(cars)[:, :2]


def bare_cars(count: int, steps: int, contacts: bool) -> Measured:
    """Measure the same wheels, motors and hinges with PyBullet alone."""
    client, step = pybullet.connect(pybullet.DIRECT), TIME_STEP / SUBSTEPS
    pybullet.setTimeStep(step, client)
    pybullet.setGravity(0, 0, -9.81, client)
    pybullet.setPhysicsEngineParameter(**ENGINE, **HEAVY, physicsClientId=client)
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    ground = pybullet.createMultiBody(0, plane, useMaximalCoordinates=1, physicsClientId=client)
    pybullet.changeDynamics(
        ground, -1, lateralFriction=1, restitution=1, contactProcessingThreshold=0, physicsClientId=client
    )
    # Setting collision filters, even to the defaults, changes the order in which contacts are solved.
    pybullet.setCollisionFilterGroupMask(
        ground, -1, collisions.GROUND, collisions.COLLIDES_WITH[collisions.GROUND], client
    )
    file = os.path.join(pybullet_data.getDataPath(), "racecar", "racecar.urdf")
    flags = pybullet.URDF_IGNORE_VISUAL_SHAPES | pybullet.URDF_USE_INERTIA_FROM_FILE
    height = WHEEL - 0.05
    cars = [
        pybullet.loadURDF(file, (0, 2.0 * row, height), flags=flags, physicsClientId=client) for row in range(count)
    ]
    for car in cars:
        for link in range(-1, pybullet.getNumJoints(car, client)):
            pybullet.setCollisionFilterGroupMask(
                car, link, collisions.FREE, collisions.COLLIDES_WITH[collisions.FREE], client
            )
    for car in cars:
        for joint in range(pybullet.getNumJoints(car, client)):
            pybullet.changeDynamics(
                car, joint, lateralFriction=0.0, linearDamping=0.0, angularDamping=0.0, physicsClientId=client
            )
        for joint in (2, 3, 5, 7):
            pybullet.changeDynamics(car, joint, lateralFriction=1.0, physicsClientId=client)
        for joint in (5, 7):
            pybullet.setJointMotorControl2(car, joint, pybullet.VELOCITY_CONTROL, force=0, physicsClientId=client)
        pybullet.resetBaseVelocity(car, (0, 0, 0), (0, 0, 0), client)
    pybullet.performCollisionDetection(client)
    aside = 0.5 * TRACK * math.tan(0.1) / WHEELBASE
    wheels = [(1.0 - aside) / WHEEL, (1.0 + aside) / WHEEL]
    touching: dict[tuple[int, int], Any] = {}
    news: list[tuple[Any, ...]] = []
    started = time.process_time()
    for _ in range(steps):
        for car in cars:
            pybullet.setJointMotorControlArray(
                car,
                (2, 3),
                pybullet.VELOCITY_CONTROL,
                targetVelocities=wheels,
                forces=(0.5, 0.5),
                physicsClientId=client,
            )
            pybullet.setJointMotorControlArray(
                car,
                (4, 6),
                pybullet.POSITION_CONTROL,
                targetPositions=hinge_angles(0.1),
                forces=(10, 10),
                physicsClientId=client,
            )
        for _ in range(SUBSTEPS):
            pybullet.stepSimulation(client)
            if contacts:
                touching = taken_contacts(client, touching, news, step)
        read: list[Any] = []
        for car in cars:
            read += (*pybullet.getBasePositionAndOrientation(car, client), *pybullet.getBaseVelocity(car, client))
            pybullet.getJointState(car, 4, client)
    used = time.process_time() - started
    pybullet.disconnect(client)
    return used, np.array([position[:2] for position in read[::4]])


def our_drones(count: int, steps: int) -> float:
    """Return agent-steps per CPU-second of quadrotors that track velocities at 48 Hz, with physics at 240 Hz."""
    model = Quadrotor()
    states = np.zeros((count, 12))
    states[:, 0], states[:, 2] = np.arange(count), 1.0
    drones = AgentGroup("drone", [f"drone{row}" for row in range(count)], model, Entity(), states)
    environment = PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=1 / 48, substeps=5))
    environment.initialise([drones], {}, 1)
    wanted = np.tile([0.3, 0.1, 0.05], (count, 1))
    with environment:
        started = time.process_time()
        for _ in range(steps):
            drones.control_input = model.follow_velocity(environment.state(drones), wanted)
            environment.step()
            environment.contacts()
        return count * steps / (time.process_time() - started)


def car_memory(visuals: bool) -> float:
    """Return the memory of each racecar beyond the first [MB]; to be called once in a fresh process."""

    def resident(count: int) -> float:
        environment = PyBulletEnvironment(PyBulletEnvironment.Parameters(visuals=visuals))
        states = [[0.0, 2.0 * row, 0.0, 0.0, 0.0] for row in range(count)]
        cars = AgentGroup("car", [f"car{row}" for row in range(count)], Racecar(), Entity(), states)
        environment.initialise([cars], {}, 1)
        environment.step()
        worlds.append(environment)
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

    worlds: list[PyBulletEnvironment] = []
    before, one, many = resident(1), resident(1), resident(21)
    return (many - one - (one - before)) / 20


def car_memory_apart(visuals: bool) -> float:
    """Measure the same in a fresh process."""
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        return process.submit(car_memory, visuals).result()


def circles() -> Iterator[tuple[str, Callable[[], Measured], Callable[[bool], Measured]]]:
    """Yield name, SymAware case, and bare case with or without contacts; cases return CPU time and final positions."""
    for engine, kind, bare, count in (
        ("pymunk circles", PymunkEnvironment, bare_pymunk, 100),
        ("pybullet spheres", PyBulletEnvironment, bare_pybullet, 50),
    ):
        for crowded in (False, True):
            for driven in (False, True):
                name = f"{count} {engine}, {'driven' if driven else 'free'}, {'crowded' if crowded else 'sparse'}"
                chosen = (count, crowded, driven, 50 if crowded or driven else 400)
                yield (
                    name,
                    partial(our_circles, kind, *chosen),
                    partial(bare, *chosen),
                )


def whole_run(engine: str, count: int, agents: int, recorded: bool, folder: Path) -> Measured:
    """Return the CPU time of a run, from its file to the end of its log, and the final positions if it was recorded."""
    grid, velocity = places(count, False)
    space = {} if engine == "pymunk" else {"ground": None, "gravity": [0, 0, 0]}
    entities = {
        f"b{n:03}": {"shape": CIRCLE, "mass": 1.0, "position": grid[n].tolist(), "velocity": velocity[n].tolist()}
        for n in range(count)
    }
    scenario: dict[str, Any] = {
        "symaware": 1,
        "name": "bodies",
        "run": {"duration": WHOLE * TIME_STEP},
        "environment": {
            "use": engine,
            "with": {"time_step": TIME_STEP, "substeps": SUBSTEPS, **space},
            "entities": entities,
        },
    }
    if agents:
        scenario["agents"] = {"nobody": {"model": {"use": "single-integrator"}, "state": FAR_AWAY}}
    file, log = folder / "bodies.yaml", folder / "bodies.mcap" if recorded else None
    file.write_text(yaml.safe_dump(scenario))
    started = time.process_time()
    summary = execute(build(file), log)
    used = time.process_time() - started
    if summary.status != "finished":
        raise SystemExit(f"the run {summary.status}: nothing can be compared")
    ends = None
    if log:
        read = open_log(log)
        ends = np.array([read.series(name, "world").values[-1, :2] for name in entities])
        log.unlink()
    return used, ends


def timed(run: Callable[[], Measured]) -> Measured:
    """Return the CPU time of a bare loop including its setup, and the final positions."""
    started = time.process_time()
    _, ends = run()
    return time.process_time() - started, ends


def whole_runs(rounds: int) -> Iterator[tuple[str, float, list[float]]]:
    """Yield name, target, and ratios of the bare engine to whole runs of SymAware."""
    for engine, count, bare in (("pymunk", 100, bare_pymunk), ("pybullet", 50, bare_pybullet)):
        for agents in (0, 1):
            for recorded, target in ((False, 0.7), (True, 0.4)):
                ratios: list[float] = []
                with tempfile.TemporaryDirectory() as folder:
                    for _ in range(rounds):
                        own, ends = whole_run(engine, count, agents, recorded, Path(folder))
                        theirs, expected = timed(partial(bare, count, False, False, WHOLE, False))
                        if ends is not None and (expected is None or not np.array_equal(ends, expected)):
                            raise SystemExit("the bare engine and SymAware differ: nothing can be compared")
                        ratios.append(theirs / own)
                bodies = f"whole run of {count} {engine} {'circles' if engine == 'pymunk' else 'spheres'}"
                yield f"{bodies}{' and an agent' * agents}{', recorded' * recorded}", target, ratios


def compared(
    ours: Callable[[], Measured], bare: Callable[[bool], Measured], rounds: int
) -> tuple[list[float], list[float]]:
    """Return, by round, the ratios of CPU time of the bare engine, without and with contacts, to that of SymAware."""
    without: list[float] = []
    asking: list[float] = []
    for _ in range(rounds):
        (own, expected), *theirs = ours(), bare(False), bare(True)
        for (used, ends), ratios in zip(theirs, (without, asking), strict=True):
            if ends is not None and (expected is None or not np.array_equal(ends, expected)):
                raise SystemExit("the bare engine and SymAware differ: nothing can be compared")
            ratios.append(used / own)
    return without, asking


def spread(ratios: Sequence[float]) -> str:
    """Format the median and the range of ratios."""
    return f"{statistics.median(ratios):.2f} x ({min(ratios):.2f} to {max(ratios):.2f})"


def row(name: str, figures: Mapping[str, Any]) -> str:
    """Format a row of the table."""
    if "ratios" not in figures:
        bound = f"< {figures['limit']:g}" if "limit" in figures else f">= {figures['target']:,g}"
        return f"| {name} | {figures['figure']:,.{'limit' in figures:d}f} | {bound} | |"
    asking = spread(figures["with contacts"]) if "with contacts" in figures else ""
    return f"| {name} | {spread(figures['ratios'])} | >= {figures['target']:g} x | {asking} |"


def measured(rounds: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name and the figures of every case."""
    for name, target, ratios in whole_runs(rounds):
        yield name, {"ratios": ratios, "target": target}
    for name, ours, bare in circles():
        without, asking = compared(ours, bare, rounds)
        yield name, {"ratios": without, "target": 0.7, "with contacts": asking}
    without, asking = compared(lambda: our_cars(5, 60), lambda asks: bare_cars(5, 60, asks), rounds)
    yield "5 racecars", {"ratios": without, "target": 0.8, "with contacts": asking}
    drones = statistics.median(our_drones(10, 300) for _ in range(rounds))
    yield "10 quadrotors, agent-steps per CPU-second", {"figure": drones, "target": 2 * PEER_DRONES}
    for visuals in (False, True):
        name = f"MB for each racecar beyond the first, {'seen' if visuals else 'not seen'} by cameras"
        yield name, {"figure": car_memory_apart(visuals), "limit": 5}


def main() -> None:
    """Measure and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="print figures only")
    arguments = parser.parse_args()
    found = {}
    if not arguments.json:
        print("| what | median (least to greatest) | target | beside a bare loop that asks for contacts |")
        print("|---|---:|---:|---:|", flush=True)
    for name, figures in measured(arguments.rounds):
        found[name] = figures
        if not arguments.json:
            print(row(name, figures), flush=True)
    if arguments.json:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
