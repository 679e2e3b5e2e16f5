"""The monitors have the published robustness on the recorded trajectory of the publication."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from test_as_recorded import PLACES
from warehouse_runs import SCENARIOS

from symaware_cli import load

Array = NDArray[np.float64]

#: The last bits do not matter here.
pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

#: Which robot had which specification: the place, when it began, and how long each leg may take.
FETCHES = {
    "fetch_1": (3, "collect_1", 1, 10),
    "fetch_2": (0, "collect_2", 2, 7),
    "fetch_3": (1, "collect_3", 3, 7),
    "fetch_4": (1, "collect_1", 15, 10),
    "fetch_5": (3, "collect_2", 15, 10),
}


def recorded() -> Array:
    """The positions of the robots; shape (4, 41, 2) [m]."""
    rows = np.loadtxt(Path(__file__).parent / "data" / "task_allocation_recorded.csv", delimiter=",", skiprows=1)
    found: Array = rows[:, 1:].reshape(len(rows), 4, 2).transpose(1, 0, 2)
    return found


def depth(positions: Array, box: tuple[float, float, float, float]) -> Array:
    """How far positions are within a box; shape (41,) [m]."""
    x, y = positions.T
    left, right, low, high = box
    found: Array = np.minimum(np.minimum(x - left, right - x), np.minimum(y - low, high - y))
    return found


@pytest.fixture(scope="module")
def robustness() -> dict[str, float]:
    """The robustness according to the monitors, of robots that are moved along the recorded trajectory."""
    moved = recorded()
    moving = {
        "agents.robot.components.plan": None,
        "agents.robot.components.disturb": None,
        "agents.robot.model.with.max_input": None,
    }
    with load(SCENARIOS / "as-recorded.yaml", moving).start() as simulation:
        for step in range(40):
            simulation.set_control("robot", moved[:, step + 1] - simulation.state("robot"))
            simulation.step()
        result = simulation.finish()
    outcomes = result.summary.specifications
    return {each.name: each.robustness for each in outcomes if each.robustness is not None}


@pytest.mark.parametrize("name", FETCHES)
def test_the_robustness_is_that_of_the_definition(robustness: dict[str, float], name: str) -> None:
    robot, place, start, leg = FETCHES[name]
    positions = recorded()[robot]
    pickup, collect = depth(positions, PLACES["pickup"]), depth(positions, PLACES[place])
    legs = [max(-pickup[at], collect[at : at + leg + 1].max()) for at in range(start, start + leg + 1)]
    expected = min(pickup[start : start + leg + 1].max(), *legs)
    assert robustness[name] == pytest.approx(expected, abs=1e-6)
    assert 1.31 <= expected <= 1.475


def test_the_other_specifications_hold_on_the_published_path(robustness: dict[str, float]) -> None:
    assert len(robustness) == 10
    assert min(robustness.values()) > 0.0
