"""What is believed of another is its position and velocity, by name, whatever perception or message made it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import Team, execute, simulate, simulation
from talking import made

from symaware_cli import (
    AwarenessDatabase,
    AwarenessVector,
    Component,
    Environment,
    GroupComponent,
    PerceptionSystem,
    open_log,
)
from symaware_cli.engine.components.communication.inbox import Inbox
from symaware_cli.engine.components.communication.state import Broadcast, StateSender
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.components.uncertainty_gaussian import GaussianUncertainty
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.engine.models.unicycle import Unicycle


class Drive(GroupComponent):
    def _compute(self) -> NDArray[np.float64]:
        inputs = np.zeros(self._group.control_input.shape)
        inputs[:, 0] = 0.5
        return inputs

    def _update(self, value: NDArray[np.float64]) -> None:
        self._group.control_input = value


class Looks(PerceptionSystem):
    """What the paper has: states by id, as the models have them."""

    def _compute(self) -> Any:
        return {id: self.environment.snapshot().state(id) for id in self.environment.roster.ids}


class Writes(Component):
    """Writes what it believes of others itself."""

    def _compute(self) -> Any:
        return {id: self.environment.snapshot().motion(id) for id in self.environment.roster.ids}

    def _update(self, value: Any) -> None:
        for id, motion in value.items():
            if id != self._agent.id:
                self._agent.awareness_database[id] = AwarenessVector(id, motion)


Makers = dict[str, Callable[[], Component | GroupComponent]]

WAYS: dict[str, tuple[Makers, Makers]] = {
    "omniscient": ({"see": OmniscientPerception}, {}),
    "range": ({"see": made(RangePerception, range=50.0)}, {}),
    "range and estimator": ({"see": made(RangePerception, range=50.0), "guess": GaussianUncertainty}, {}),
    "states told": ({"see": SelfPerception, "hear": Inbox}, {"tell": StateSender}),
    "broadcasts": ({"see": SelfPerception, "hear": Inbox}, {"tell": Broadcast}),
    "states by id": ({"see": Looks}, {}),
    "written": ({"see": SelfPerception, "write": Writes}, {}),
}
MODELS = {
    "single integrator": SingleIntegrator(),
    "double integrator": DoubleIntegrator(),
    "unicycle": Unicycle(),
    "quadrotor": Quadrotor(),
}
each_way = pytest.mark.parametrize("way", WAYS)
each_model = pytest.mark.parametrize("model", MODELS)


def teams(way: str, model: str) -> dict[str, Team]:
    watching, telling = WAYS[way]
    size = len(MODELS[model].state)
    return {
        "watcher": Team({**watching, "drive": Drive}),
        "other": Team(
            {"see": SelfPerception, "drive": Drive, **telling},
            state=[[3.0, 4.0, *[0.1] * (size - 2)]],
            model=MODELS[model],
        ),
    }


def believed(way: str, model: str) -> tuple[AwarenessDatabase, Environment]:
    ready = simulation(teams(way, model))
    summary = execute(ready, 4)
    assert summary.status == "finished", summary.failure
    watcher = next(group for group in ready.groups if group.name == "watcher").agents[0]
    return watcher.awareness_database, ready.environment


@each_model
@each_way
def test_it_has_the_same_names_and_numbers_whoever_made_it(way: str, model: str) -> None:
    (database, world), (expected, _) = believed(way, model), believed("omniscient", model)
    axes = "xyz"[: world.roster.dimensions]
    elements, right = database.elements("other"), expected.elements("other")
    assert list(elements) == [*axes, *(f"v{axis}" for axis in axes)]
    for name, value in elements.items():
        # A perception that hands over states tells no velocity that is no part of them.
        if way != "states by id" or not np.isnan(value):
            late = 0.6 if name[0] == "v" and way in ("states told", "broadcasts") else 0.03  # a step of free fall
            assert value == pytest.approx(right[name], abs=late)
    assert not np.isnan([elements[axis] for axis in axes]).any()
    assert database["other"].state.tolist() == pytest.approx(list(elements.values()), nan_ok=True)
    assert list(database.elements("watcher")) == ["x", "y"]


@each_model
@each_way
def test_the_log_has_the_same_columns_whoever_made_it(way: str, model: str, tmp_path: Path) -> None:
    simulate(teams(way, model), 4, tmp_path / "log")
    log = open_log(tmp_path / "log")
    axes = "xyz"[: 3 if model == "quadrotor" else 2]
    names = (*axes, *(f"v{axis}" for axis in axes))
    assert log.channels["/agents/watcher/awareness"].metadata["columns"] == ",".join(names)
    beliefs = log.beliefs("watcher", "other")
    assert beliefs.columns == names
    truth = log.series("other", "world")
    for axis in axes[:2]:
        found = beliefs.column(axis)[-1]
        number = min(np.searchsorted(truth.times, beliefs.times[-1], "right") - 1, len(truth.times) - 1)
        assert found == pytest.approx(truth.column(axis)[number], abs=0.05)


def test_a_belief_of_the_wrong_size_is_refused_with_both_valid_forms() -> None:
    ready = simulation({"robot": Team(count=2, model=Unicycle())})
    ready.initialise()
    database = ready.groups[0].agents[0].awareness_database
    for wrong in ([1.0], [1.0] * 5, [[1.0, 2.0]]):
        with pytest.raises(
            ValueError, match=r"its position and velocity, 4 numbers \(x, y, vx, vy\), or a state of its"
        ):
            database["robot.1"] = AwarenessVector("robot.1", wrong)
    database["robot.1"] = AwarenessVector("robot.1", [1.0, 2.0, 0.3])
    assert np.array_equal(database["robot.1"].state, [1.0, 2.0, np.nan, np.nan], equal_nan=True)
