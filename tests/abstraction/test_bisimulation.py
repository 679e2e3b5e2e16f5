import itertools
from pathlib import Path

import numpy as np
import pytest

from symaware_cli.abstraction.bisimulation import bisimulation
from symaware_cli.abstraction.graph_file import GraphFile
from symaware_cli.abstraction.grid_cells import GridCells
from symaware_cli.abstraction.transition_system import TransitionSystem
from symaware_cli.geometry.region import Region

SIDE = 0.5


def grid() -> GridCells:
    made = GridCells(GridCells.Parameters(cell=SIDE, region="arena"))
    made.prepare({"arena": Region(box=(0, 2, 0, 1.5))})
    return made


def with_all_within(model: GridCells, steps: int) -> GridCells:
    """Add the transitions to all cells at most some columns and rows away."""
    middles = np.round(model.bounds[:, :, 0] / SIDE).astype(int)
    after = tuple(tuple(np.flatnonzero((np.abs(middles - here) <= steps).all(axis=1)).tolist()) for here in middles)
    system = model.system
    model.system = TransitionSystem(system.states, system.initial, after, system.labels)
    return model


@pytest.mark.parametrize("steps", [1, 2])
def test_cells_with_transitions_to_all_within_reach_are_a_bisimulation(steps: int) -> None:
    model = with_all_within(grid(), steps)
    assert bisimulation(model, steps * SIDE).holds
    assert not bisimulation(model, 0.9 * steps * SIDE).follows
    assert bisimulation(model, (steps + 1) * SIDE).missing


def test_strategies_for_a_grid_can_be_followed_although_diagonals_are_missing() -> None:
    found = bisimulation(grid(), SIDE)
    assert found.follows
    assert not found.holds
    assert ("c0_0", "c1_1") in found.missing


def test_moves_drawn_at_random_agree_with_the_comparison() -> None:
    model, reach = grid(), 0.7
    found, draw = bisimulation(model, reach), np.random.default_rng(1)
    count = len(model.bounds)
    seen = np.zeros((count, count), bool)
    for _ in range(20_000):
        start = draw.uniform([0, 0], [2, 1.5])
        end = start + draw.uniform(-reach, reach, 2)
        one, other = model.cells(np.array([start, end]))
        if other >= 0:
            seen[one, other] = True
    for one, other in itertools.product(range(count), repeat=2):
        names = model.system.states[one], model.system.states[other]
        expected = names in found.missing or other in model.system.successors[one]
        assert seen[one, other] == expected, names


def test_states_without_places_are_not_compared_with_an_integrator(tmp_path: Path) -> None:
    (tmp_path / "gripper.yaml").write_text("transitions: {empty: [empty]}")
    gripper = GraphFile(GraphFile.Parameters.model_validate({"graph": {"file": "gripper.yaml"}, "places": False}))
    gripper.folder = tmp_path
    gripper.prepare({})
    with pytest.raises(ValueError, match="have no places"):
        bisimulation(gripper, 1.0)
