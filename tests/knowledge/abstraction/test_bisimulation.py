import itertools
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.linear import Linear
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.geometry.region import Region
from symaware_cli.knowledge.abstraction.bisimulation import bisimulation
from symaware_cli.knowledge.abstraction.graph_file import GraphFile
from symaware_cli.knowledge.abstraction.grid_cells import GridCells
from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.knowledge.graph_text import GraphText
from symaware_cli.planning.optimal_control import LinearDynamics

Array = NDArray[np.float64]

SIDE = 0.5


def grid(box: tuple[float, float, float, float] = (0, 2, 0, 1.5)) -> GridCells:
    made = GridCells(GridCells.Parameters(cell=SIDE, region="arena"))
    made.prepare({"arena": Region(box=box)})
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
    gripper.folder, gripper.open_file = tmp_path, GraphText
    gripper.prepare({})
    with pytest.raises(ValueError, match="have no places"):
        bisimulation(gripper, 1.0)


#: Linear motion with inputs in a box: decoupled, coupled by a rotation, with a drift, and with more inputs than axes.
TURN = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
MOTIONS = {
    "integrator": (np.eye(2), np.eye(2), np.zeros(2), 0.7),
    "inputs that are turned": (np.eye(2), TURN, np.zeros(2), 0.6),
    "turned state": (TURN, np.eye(2), np.array([0.3, -0.5]), 0.6),
    "drift": (np.eye(2), np.diag([1.0, 0.3]), np.array([0.5, 0.0]), 0.6),
    "three inputs that contract": (
        np.diag([0.6, 0.9]),
        np.array([[1.0, 0.2, 0.1], [0.0, 0.4, -0.5]]),
        np.array([0.3, 0.1]),
        0.5,
    ),
}


def dynamics(A: Array, B: Array, c: Array, limit: float) -> LinearDynamics:
    inputs = np.full(B.shape[1], limit)
    return LinearDynamics(A, B, c, -inputs, inputs, np.zeros((0, B.shape[1])), np.zeros(0))


def cells_of(points: Array) -> NDArray[np.intp]:
    """The numbers of the cells of `grid` in which points lie, -1 outside."""
    column, row = np.floor(points / SIDE).astype(int).T
    return np.where((column >= 0) & (column < 4) & (row >= 0) & (row < 3), column + 4 * row, -1)


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=[pytest.mark.slow] if "that" in kind or "turned" in kind else []) for kind in MOTIONS],
)
def test_moves_of_linear_models_drawn_at_random_agree_with_the_comparison(kind: str) -> None:
    A, B, c, limit = MOTIONS[kind]
    model, draw = grid(), np.random.default_rng(2)
    count = len(model.bounds)
    system = model.system
    everything = tuple(tuple(range(count)) for _ in range(count))
    model.system = TransitionSystem(system.states, system.initial, tuple(() for _ in range(count)))
    missing = set(bisimulation(model, moves=dynamics(A, B, c, limit)).missing)
    model.system = TransitionSystem(system.states, system.initial, everything)
    impossible = set(bisimulation(model, moves=dynamics(A, B, c, limit)).impossible)
    starts = draw.uniform([0, 0], [2, 1.5], (150_000, 2))
    inputs = draw.uniform(-limit, limit, (len(starts), B.shape[1]))
    one, other = cells_of(starts), cells_of(starts @ A.T + inputs @ B.T + c)
    pairs, counts = np.unique(np.stack([one, other])[:, other >= 0], axis=1, return_counts=True)
    seen = {(system.states[a], system.states[b]) for a, b in pairs.T.tolist()}
    often = {(system.states[a], system.states[b]) for (a, b), n in zip(pairs.T.tolist(), counts, strict=True) if n > 3}
    # What was seen is a move; what is a move was seen, unless only a small part of the inputs leads there.
    assert seen <= missing
    assert len(missing - often) <= 0.15 * len(missing)
    # From each corner of a cell, whether an input leads into another, by trying many of them.
    tried = np.array(list(itertools.product(np.linspace(-limit, limit, 13), repeat=B.shape[1])))
    low, high = model.bounds[:, :, 0], model.bounds[:, :, 1]
    for place in (0, count // 2):
        corners = np.array(list(itertools.product(*model.bounds[place])))
        ends = (corners @ A.T)[:, None] + tried @ B.T + c
        for target in range(count):
            found = ((ends >= low[target] - 1e-9) & (ends <= high[target] + 1e-9)).all(axis=2).any(axis=1).all()
            if found:
                assert (system.states[place], system.states[target]) not in impossible


def test_velocities_stay_within_their_bounds() -> None:
    model = DoubleIntegrator(DoubleIntegrator.Parameters())
    cells = with_all_within(grid((0, 1, 0, 0.5)), 1)
    weak = LinearDynamics.of(model, 1.0)
    limits = np.full(2, 2.0)
    strong = LinearDynamics(weak.A, weak.B, weak.c, -limits, limits, np.zeros((0, 2)), np.zeros(0))
    bounds = {"x2": (-0.1, 0.1), "x3": (-0.1, 0.1)}
    # To stay in a cell at rest takes no input; to leave it, a velocity that a step later is out of bounds.
    found = bisimulation(cells, moves=strong, bounds=bounds)
    assert ("c0_0", "c1_0") in found.impossible
    assert not found.missing
    with pytest.raises(ValueError, match="x3"):
        bisimulation(cells, moves=strong, bounds={"x2": (-0.1, 0.1)})


def test_a_model_is_compared_if_it_is_linear_and_its_inputs_are_in_a_box() -> None:
    model = with_all_within(grid(), 1)
    identity, names = [[1.0, 0.0], [0.0, 1.0]], {"x": "m", "y": "m"}
    given = {"time_step": 2.0, "state": names, "control_input": names, "A": identity, "B": identity, "max_input": 0.5}
    assert bisimulation(model, moves=Linear(Linear.Parameters.model_validate(given))) == bisimulation(model, 0.5)
    round_inputs = SingleIntegrator(SingleIntegrator.Parameters(max_speed=0.5))
    with pytest.raises(ValueError, match="in a box"):
        bisimulation(model, moves=round_inputs, step=1.0)
    with pytest.raises(ValueError, match="not linear"):
        bisimulation(model, moves=Unicycle(Unicycle.Parameters()), step=1.0, bounds={"heading": (-3.0, 3.0)})
    with pytest.raises(ValueError, match="reach"):
        bisimulation(model)
