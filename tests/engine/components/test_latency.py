"""What a component computes lands later by its latency and is otherwise the same; and to compute changes nothing."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import STEP, Team, execute, simulation, untyped

from symaware_cli import Entity, Environment, GroupComponent, Model
from symaware_cli.core import Agent, AgentGroup, Frame, Parameters, Snapshot, Subscription, Surroundings, Tracks
from symaware_cli.engine.components.perception import OmniscientPerception
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.timing import STEADY, Timing
from symaware_cli.geometry.region import Region
from symaware_cli.knowledge.abstraction.grid_cells import GridCells
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.learning.learning_content import LearningUse
from symaware_cli.learning.learning_task import LearningTask
from symaware_cli.roads.lane import Lane
from symaware_cli.roads.road_network import RoadNetwork
from symaware_cli.specification.formulation import formulate
from symaware_cli.specification.parser import parse
from symaware_cli.specification.scope import AgentScope
from symaware_cli.specification.specification import Specification
from symaware_cli.specification.specification_monitor import SpecificationMonitor
from symaware_cli.world.chance import AgentChance, GroupChance
from symaware_cli.world.probability_distribution import always
from symaware_cli.world.reading import Scan

#: Steps between two turns, and what their latency is; less, so that no turn is put off.
PERIOD, LATENCY, STEPS = 4, 2, 26

DISC = Entity.model_validate({"shape": {"circle": {"radius": 0.3}}})


def bullet() -> Environment:
    pytest.importorskip("pybullet", reason="PyBullet is an extra")
    from symaware_cli.worlds.spatial import PyBulletEnvironment

    return PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=STEP / 1e9))


def kinematic() -> Environment:
    return KinematicEnvironment(KinematicEnvironment.Parameters(time_step=STEP / 1e9))


@dataclass
class Case:
    """What a component needs, and what it writes into what others can see of its agents."""

    writes: Sequence[str]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    knowledge: Mapping[str, Any] = field(default_factory=dict)
    before: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    others: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    model: Model = field(default_factory=Unicycle)
    specification: str | None = None
    regions: Mapping[str, Region] = field(default_factory=dict)
    world: Any = kinematic


LINE = [[0, 0], [3, 0], [3, 3]]
TIMED = [[0, 0, 0], [3, 3, 0], [6, 3, 3]]
SEES = {"perception.range": {"range": 9.0}}
ACTS = ["control", "intent"]
REGIONS = {"floor": Region(box=(-1, 4, -1, 4)), "right": Region(box=(2, 4, -1, 4)), "left": Region(box=(-1, 0, -1, 4))}
PATROL = {"model": "floor", "guarantees": ["always eventually right", "always eventually left"]}
CASES = {
    "allocation.auction": Case([]),
    "allocation.nearest": Case([]),
    "perception.self": Case(["state"]),
    "perception.omniscient": Case(["state", "world"]),
    "perception.range": Case(["observation", "seen", "state"], {"range": 9.0, "delay": 0.15, "position_noise": 0.1}),
    "perception.camera": Case(["readings"], {"width": 8, "height": 6, "delay": 0.3}, world=bullet),
    "perception.contact": Case(["signals"], {"noise": 0.1, "delay": 0.3}),
    "perception.imu": Case(["signals"], {"acceleration_noise": 0.1, "acceleration_bias": 0.1}),
    "perception.lidar": Case(["readings"], {"rays": 8, "noise": 0.1, "delay": 0.3}),
    "uncertainty.gaussian": Case(
        ["seen", "state", "uncertainty"],
        before={"perception.range": {"range": 9.0, "delay": 0.15, "position_noise": 0.1, "self_noise": 0.1}},
    ),
    "uncertainty.conformal": Case(["signals"], {"horizon": 1.0}, before={"perception.range": {"range": 9.0}}),
    "risk.time-to-collision": Case(["risk"]),
    "risk.collision": Case(["risk"]),
    "risk.map": Case(["signals"], {"within": [-2.0, 2.0, -2.0, 2.0], "resolution": 1.0, "record": 1e-6}),
    "risk.specification": Case(
        ["risk", "signals"],
        {"specifications": ["safe"], "samples": 20, "horizon": 0.5},
        model=SingleIntegrator(SingleIntegrator.Parameters(process_noise=0.2)),
        specification="always (nearest > 1 and y < 0.8)",
    ),
    "control.go-to-goal": Case(ACTS, knowledge={"goal": [3, 3]}),
    "control.velocity-obstacle": Case(ACTS, knowledge={"goal": [3, 3]}),
    "control.dynamic-window": Case(
        ACTS, {"scan": "perception-lidar"}, {"goal": [3, 3]}, before={"perception.lidar": {"rays": 24}}
    ),
    "control.vector-field-histogram": Case(
        ACTS, {"scan": "perception-lidar"}, {"goal": [3, 3]}, before={"perception.lidar": {"rays": 24}}
    ),
    "control.waypoints": Case(ACTS, knowledge={"waypoints": LINE}),
    "control.pure-pursuit": Case(ACTS, knowledge={"waypoints": LINE}, model=Bicycle()),
    "control.follow": Case(ACTS, {"leader": "other"}, {"offset": [-1, 0]}),
    "control.mpc": Case(
        ACTS, {"horizon": 1.6, "steps": 8, "neighbours": 0, "obstacles": 0}, {"goal": [3, 3]}, model=SingleIntegrator()
    ),
    "control.stl": Case(
        [*ACTS, "signals"],
        {"specifications": ["safe"], "interval": 0.1, "horizon": 0.5},
        model=SingleIntegrator(SingleIntegrator.Parameters(max_speed=2.0)),
        specification="always (x > -9 and y < 9)",
    ),
    "control.quadrotor-velocity": Case(ACTS, knowledge={"velocity": [1, 0, 0]}, model=Quadrotor()),
    "control.cells": Case(
        ["control", "intent"],
        {"strategy": "knowledge-strategy", "model": "floor"},
        before={"knowledge.strategy": PATROL},
        regions=REGIONS,
    ),
    "knowledge.blocked-cells": Case(["signals"], {"model": "floor"}, {"blocked": ["c1_1"]}, regions=REGIONS),
    "knowledge.strategy": Case(["signals"], PATROL, regions=REGIONS),
    "control.schedule": Case(
        ["control"], {"inputs": [{"time": 0.1 * number, "input": [1.0, 0.1 * number]} for number in range(20)]}
    ),
    "control.random": Case(["control"], {"inputs": [[1.0, 0.0], [0.0, 1.0]]}),
    "control.risk-aware": Case(["control"], before={"risk.time-to-collision": {"horizon": 9.0}}),
    "control.barrier-filter": Case(["control", "signals"], {"gain": 0.1}),
    "control.lane-keeping": Case(ACTS, {"speed": 2.0}),
    "control.car-following": Case(ACTS, {"speed": 2.0}, before=SEES),
    "control.lane-change": Case(ACTS, {"speed": 2.0, "decide": 0.1}, before=SEES),
    "control.policy": Case(["control"], {"policy": {"file": "policies/goal.onnx"}}),
    "communication.map": Case(
        ["signals"],
        {"scan": "perception-lidar", "resolution": 0.5, "within": (-5, 5, -5, 5), "record": 0.1, "interval": 0.2},
        before={"perception.lidar": {"rays": 24}},
    ),
    "perception.map": Case(
        ["signals"],
        {"scan": "perception-lidar", "resolution": 0.5, "within": (-5, 5, -5, 5), "record": 0.1},
        before={"perception.lidar": {"rays": 24}},
    ),
    "control.timed-waypoints": Case(ACTS, knowledge={"timed_waypoints": TIMED}),
    "planning.cbs": Case([], {"within": (-5, 5, -5, 5)}, {"goal": [3, 3]}),
    "planning.prioritised": Case([], {"within": (-5, 5, -5, 5)}, {"goal": [3, 3]}),
    "planning.roadmap": Case([], {"samples": 200, "within": (-5, 5, -5, 5)}, {"goal": [3, 3]}),
    "planning.rrt-star": Case([], {"iterations": 50, "within": (-5, 5, -5, 5)}, {"goal": [3, 3]}),
    "planning.lattice": Case([], {"turning_radius": 1.0, "within": (-5, 5, -5, 5)}, {"goal": [3, 3]}),
    "planning.grid": Case([], {"resolution": 0.5, "within": (-5, 5, -5, 5)}, {"goal": [3, 3]}),
    "communication.state": Case([]),
    "communication.broadcast": Case([]),
    "communication.gossip": Case([], knowledge={"rumour": 1}),
    "communication.flooding": Case([], {"names": ["x"]}, {"x": 1}),
    "communication.consensus": Case([], {"name": "x", "gain": 0.2}, {"x": 1.0}),
    "communication.request": Case([], {"whom": ["other"], "names": ["x"]}, others={"communication.request": {}}),
    "communication.inbox": Case(["received"], others={"communication.state": {}}),
}


class Drive(GroupComponent):
    """Moves the agents in a way of its own, whatever anybody wants, so that the world is the same in all runs."""

    def _compute(self) -> NDArray[np.float64]:
        inputs = np.zeros(self._group.control_input.shape)
        inputs[:, 0] = 0.7 + 0.3 * np.sin(3.0 * self.time + np.arange(len(inputs)))
        inputs[:, 1] = 0.4 * np.cos(2.0 * self.time)
        return inputs

    def _update(self, value: NDArray[np.float64]) -> None:
        self._group.control_input = value


class Probe(GroupComponent):
    """Takes note of all that others can see of the agents."""

    def __init__(self, notes: Sequence[Any]) -> None:
        super().__init__()
        self.notes = notes

    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        untyped(self.notes).append(visible(self._group))


def visible(group: AgentGroup) -> dict[str, Any]:
    awareness = group.awareness
    parts = {"state": awareness.state, "control": group.control_input, "knowledge": [dict(k) for k in group.knowledge]}
    for name in ("intent", "uncertainty", "risk"):
        column = getattr(awareness, name)
        parts[name] = [(column.row(row).times, column.row(row).values) for row in range(len(group))]
    world, observation = awareness.world, awareness.observation
    parts["world"] = world and (world.time, world.states)
    parts["seen"], parts["received"] = tracks(awareness.seen), tracks(awareness.received)
    parts["observation"] = observation and (observation.time, observation.state, tracks(observation.tracks))
    parts["readings"] = {name: vars_of(each) for name, each in awareness.readings.items()}
    parts["signals"] = {name: awareness[name] for name in awareness.signals}
    return {name: plain(part) for name, part in parts.items()}


def tracks(of: Tracks | None) -> list[Any] | None:
    return None if of is None else [getattr(of, name) for name in Tracks.__slots__]


def vars_of(reading: Frame | Scan) -> list[Any]:
    return [getattr(reading, each.name) for each in fields(reading)]


def plain(value: Any) -> Any:
    """A value that equals another one with the same numbers."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return (
        [plain(getattr(value, name)) for name in ("colour", "depth", "segments")] if hasattr(value, "depth") else value
    )


#: What components share, and what they draw from.
SHARED = (
    Agent,
    AgentGroup,
    Surroundings,
    Model,
    Environment,
    Subscription,
    Parameters,
    AgentChance,
    GroupChance,
)


def contents(value: Any, outer: tuple[int, ...] = ()) -> Any:
    """All that an object of this package consists of, as values to compare."""
    if isinstance(value, SHARED) or id(value) in outer:
        return None
    if isinstance(value, Snapshot):
        return value.time, plain(value.states)
    if isinstance(value, SpecificationMonitor):
        assert value.lower is not None  # its results are combined when they are read
    outer = (*outer, id(value))
    if isinstance(value, Mapping):
        return {name: contents(each, outer) for name, each in value.items()}
    if isinstance(value, list | tuple | set | deque):
        return [contents(each, outer) for each in value]
    if isinstance(value, np.ndarray):
        return plain(value)
    if type(value).__module__.startswith("symaware_cli") and not isinstance(value, Enum):
        slots = (name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ()))
        attributes = {name: getattr(value, name, None) for name in slots} | dict(getattr(value, "__dict__", {}))
        return {name: contents(each, outer) for name, each in attributes.items() if name != "__weakref__"}
    return value if isinstance(value, float | int | str | bytes | None) else id(value)


def watching(kind: Any) -> Any:
    """The component, which fails where its `_compute` changes anything that somebody can see, or itself."""

    class Watching(kind):  # type: ignore[misc] # whichever class that is
        def _everything(self) -> tuple[dict[str, Any], dict[str, Any], int]:
            group = self._group if isinstance(self, GroupComponent) else self._agent.group
            # What follows from the scenario may be computed when it is needed.
            derived = ("_random", *getattr(self, "uncaptured", ()))
            own = {name: each for name, each in vars(self).items() if name not in derived}
            return visible(group), contents(own), self._surroundings.exchange.sent

        def _compute(self) -> NDArray[np.float64] | Snapshot | tuple[Any, Any]:
            before = self._everything()
            value = super()._compute()
            for one, other, what in zip(before, self._everything(), ("awareness", "itself", "messages"), strict=True):
                assert one == other, f"to compute changes {what}"
            result: NDArray[np.float64] | Snapshot | tuple[Any, Any] = value
            return result

    return Watching


def run(use: str, latency: int) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """What is visible before and after the turns of a component, step by step."""
    case, catalogue = CASES[use], Catalogue()
    if use == "control.stl":
        pytest.importorskip("highspy", reason="HiGHS is an extra")
    if use == "control.mpc":
        pytest.importorskip("casadi", reason="CasADi is an extra")
    if use == "control.barrier-filter":
        pytest.importorskip("daqp", reason="DAQP is an extra")

    def make(
        name: str, parameters: Mapping[str, Any], wrap: Callable[..., Any] = lambda kind: kind
    ) -> Callable[..., Any]:
        kind = catalogue.load("component", name)
        return partial(wrap(kind), kind.Parameters(**parameters))

    notes: tuple[list[Any], list[Any]] = [], []
    size = len(case.model.state)
    robots = Team(
        {
            **({} if "state" in case.writes else {"sense": OmniscientPerception}),
            **{name.replace(".", "-"): make(name, each) for name, each in case.before.items()},
            "first": lambda: Probe(notes[0]),
            "it": make(use, case.parameters, watching),
            "last": lambda: Probe(notes[1]),
            "drive": Drive,
        },
        count=2,
        state=[[0.0] * size, [0.7, 0.7, *[0.0] * (size - 2)]],
        knowledge=[case.knowledge] * 2,
        model=case.model,
        entity=DISC,
        timings={"it": Timing(PERIOD * STEP, latency=always(latency * STEP / 1e9))},
    )
    other = Team(
        {"drive": Drive, **{name.replace(".", "-"): make(name, each) for name, each in case.others.items()}},
        state=[[2.0, 0.2]],
        knowledge=[{"x": 1}],
        entity=DISC,
    )
    ready = simulation({"robot": robots, "other": other}, environment=case.world())
    options = RunOptions()
    if case.regions:
        floor = GridCells(GridCells.Parameters(cell=1.0, region="floor"))
        floor.prepare(case.regions)
        ready.groups[1].sections = {"knowledge_models": {"floor": floor}}
    if use == "control.policy":
        ready.environment.folder = Path(__file__).parents[3] / "scenarios"
        observed = LearningUse(agents="robot", observation=["position"])
        ready.groups[1].sections = {"learning": LearningTask(observed, None)}
    if use in ("control.lane-keeping", "control.car-following", "control.lane-change"):
        sides = (np.array([[-50.0, 2.0], [50.0, 2.0]]), np.array([[-50.0, -2.0], [50.0, -2.0]]))
        ready.groups[1].sections = {"roads": RoadNetwork([Lane("one", *sides)])}
    if case.specification is not None:
        scope = AgentScope(ready.groups[1], ready.environment, ready.groups, {})
        formulation = formulate(parse(case.specification, scope.names, {}), STEP)
        options = RunOptions(specifications=[Specification("safe", "truth", "robot", scope, formulation)])
    summary = execute(ready, STEPS, options=options)
    assert summary.status == "finished", summary.failure
    return notes


def test_there_is_a_case_for_every_built_in_component() -> None:
    catalogue = Catalogue()
    # What plays a file back is tested in tests/bags; what a switch chooses depends on how long it has been in force, so
    # that a latency is more than a shift; what promises are made, a section says: tests/promises.
    elsewhere = {"perception.bag", "control.switch", "promises.monitor", "promises.tell"}
    assert {each.name for each in catalogue.listings("component") if each.built_in} == {*CASES, *elsewhere}


@pytest.mark.parametrize("use", CASES)
def test_a_latency_is_a_shift(use: str) -> None:
    case = CASES[use]
    (before, at_once), (_, late) = run(use, 0), run(use, LATENCY)
    written = set()
    for turn in range(0, STEPS - LATENCY, PERIOD):
        changed = {name for name in at_once[turn] if at_once[turn][name] != before[turn][name]}
        written |= changed
        for name in changed & set(case.writes):
            assert late[turn + LATENCY][name] == at_once[turn][name], (turn, name)
    assert set(case.writes) <= written


def test_a_component_knows_when_it_computed_what_it_is_to_write() -> None:
    noted = []

    class Notes(GroupComponent):
        def _compute(self) -> int:
            return self.now

        def _update(self, value: int) -> None:
            noted.append((value == self.computed_at, self.now - self.computed_at))

    for timing in (STEADY, Timing(latency=always(LATENCY * STEP / 1e9), period=PERIOD * STEP)):
        execute(simulation({"robot": Team({"note": Notes}, timings={"note": timing})}), 4)
    assert noted == [(True, 0)] * 4 + [(True, LATENCY * STEP)]
