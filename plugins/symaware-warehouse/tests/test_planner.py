"""Plans are the best of all choices, as an enumeration of them finds it, and keep to their tubes and risks."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog, minimize
from symaware_warehouse import Commitment, Planner, Progress, Tube

from symaware_cli.engine.models.linear import Linear
from symaware_cli.formulas import Region
from symaware_cli.planning.optimal_control import LinearDynamics, predicate_sets, state_names
from symaware_cli.specification import formulate, parse

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

SECOND = 1_000_000_000
VARIANCE = 0.0117082
SPEED = 3.0
MODEL = Linear(
    Linear.Parameters(
        time_step=1.0,
        state={"x": "m", "y": "m"},
        control_input={"u": "m", "v": "m"},
        A=[[1, 0], [0, 1]],
        B=[[1, 0], [0, 1]],
        max_input=SPEED,
    )
)
#: The steps of the small instances.
STEPS = 3
DYNAMICS = LinearDynamics.of(MODEL, 1.0)
TUBE = Tube.of("chebyshev", VARIANCE, 0.01)
#: The weight of the energy in comparisons with it: large, so that it decides between alternatives.
ENERGY = 0.02
#: Squares consist of so many tangents in a search, and so much less than the squares they come to at most.
TANGENTS = 25
BELOW = ENERGY * 2 * STEPS * (SPEED / (TANGENTS - 1)) ** 2


def commitment(text: str, boxes: dict[str, Box], start: int = 0, epsilon: float | None = None) -> Commitment:
    regions = {name: Region(box=box) for name, box in boxes.items()}
    formulation = formulate(parse(text, [*state_names(MODEL), *regions], {"inside": 2}), SECOND)
    return Commitment(text, formulation, predicate_sets(formulation, state_names(MODEL), regions), start, epsilon)


def planner(steps: int, tube: Tube = TUBE, energy: float = 0.0) -> Planner:
    return Planner(DYNAMICS, tube, steps, energy=energy, gap=1e-7, tangents=TANGENTS)


class Choice(NamedTuple):
    """The program of a choice of instants and sides, in x, y, radius and risk of the steps 1 to 3.

    Attributes:
        rows: Shape (m, 12).
        limits: The upper bounds of the rows; shape (m,).
    """

    rows: Array
    limits: Array

    def least(self, state: Array | None = None, energy: float = 0.0) -> tuple[float, Array]:
        """The least sum of the risks, and of a bound of the energy from below; infinite if there is none."""
        n = STEPS
        bounds = [*self._bounds(), *[(0.0, None)] * 2 * n]
        cost = np.concatenate([np.zeros(3 * n), np.ones(n), np.full(2 * n, energy)])
        rows, limits = [np.pad(self.rows, ((0, 0), (0, 2 * n)))], [self.limits]
        if state is not None:
            # Each square is above its tangents.
            moves, offset = self._moves(state)
            for at in np.linspace(-SPEED, SPEED, 13):
                rows.append(np.hstack([2.0 * at * moves, -np.eye(2 * n)]))
                limits.append(at * at - 2.0 * at * offset)
        found = linprog(cost, np.vstack(rows), np.concatenate(limits), bounds=bounds, method="highs")
        return (np.inf, np.empty(0)) if found.x is None else (float(cost @ found.x), found.x[: 4 * n])

    def least_square(self, state: Array, energy: float, start: Array) -> float:
        """The least sum of the risks and of the energy itself, from a point that satisfies the rows."""
        moves, offset = self._moves(state)

        def cost(values: Array) -> tuple[float, Array]:
            move, slope = moves @ values + offset, np.zeros(4 * STEPS)
            slope[3 * STEPS :] = 1.0
            return float(values[3 * STEPS :].sum() + energy * move @ move), slope + 2.0 * energy * move @ moves

        rows = {"type": "ineq", "fun": lambda values: self.limits - self.rows @ values, "jac": lambda _: -self.rows}
        given: Any = {"jac": True, "bounds": self._bounds(), "constraints": [rows]}
        found = minimize(cost, start, method="SLSQP", options={"ftol": 1e-13, "maxiter": 500}, **given)
        assert found.success, found.message
        return float(found.fun)

    @staticmethod
    def _bounds() -> list[Any]:
        n = STEPS
        return [*[(None, None)] * 2 * n, *[(TUBE.least, TUBE.greatest)] * n, *[(TUBE.least_risk, 1.0)] * n]

    @staticmethod
    def _moves(state: Array) -> tuple[Array, Array]:
        """The control inputs as a matrix and an offset of the variables; shapes (6, 12) and (6,)."""
        n = STEPS
        difference = np.eye(n) - np.eye(n, k=-1)
        moves, offset = np.zeros((2 * n, 4 * n)), np.zeros(2 * n)
        for axis in range(2):
            moves[axis * n : (axis + 1) * n, axis * n : (axis + 1) * n] = difference
            offset[axis * n] = -state[axis]
        return moves, offset


class Errand(NamedTuple):
    """A small instance: reach one box, then another, and avoid a wall in between.

    Attributes:
        state: The position of the robot.
        first: The box to be in at one of the steps 1 and 2.
        second: The box to be in at one of the steps 2 and 3.
        wall: The box to avoid at the steps 1 and 2.
        epsilon: The limit of the sum of the risks.
    """

    state: Array
    first: Box
    second: Box
    wall: Box
    epsilon: float

    @classmethod
    def drawn(cls, seed: int) -> Errand:
        """Draw an instance: some are impossible for want of speed, and some for their risk."""
        generator = np.random.Generator(np.random.PCG64(seed))

        def box(centre: Array, least: float, most: float) -> Box:
            x, y = centre.tolist()
            width, height = generator.uniform(least, most, 2)
            return (x - width, x + width, y - height, y + height)

        state = generator.uniform(-1.0, 1.0, 2)
        first = box(generator.uniform(0.0, 5.0, 2), 0.2, 1.8)
        second = box(generator.uniform(1.0, 7.0, 2), 0.2, 1.8)
        wall = box(generator.uniform(1.5, 4.0, 2), 0.2, 1.0)
        return cls(state, first, second, wall, float(generator.uniform(0.1, 2.4)))

    def commitment(self) -> Commitment:
        text = (
            "eventually[1, 2] inside(position, first) and eventually[2, 3] inside(position, second) "
            "and always[1, 2] not inside(position, wall)"
        )
        return commitment(text, {"first": self.first, "second": self.second, "wall": self.wall}, 0, self.epsilon)

    def best(self) -> float:
        """The least sum of the risks over all choices of instants and sides; infinite if none is possible."""
        best, floor = np.inf, STEPS * TUBE.least_risk
        for one, other, *sides in product((1, 2), (2, 3), self._sides(1), self._sides(2)):
            best = min(best, self._program(one, other, sides).least()[0])
            if best <= floor + 1e-9:
                break
        return best

    def best_with_energy(self) -> float:
        """The least sum of risks and energy, by sequential quadratic programs; infinite if none is possible."""
        choices = product((1, 2), (2, 3), self._sides(1), self._sides(2))
        programs = [self._program(one, other, sides) for one, other, *sides in choices]
        found = sorted(((*each.least(self.state, ENERGY), each) for each in programs), key=lambda each: each[0])
        best = np.inf
        for bound, start, program in found:
            if bound >= best:
                break
            best = min(best, program.least_square(self.state, ENERGY, start))
        return best

    def _sides(self, step: int) -> list[int]:
        """The sides of the wall on which the robot can be at a step, with the narrowest tube."""
        left, right, low, high = self.wall
        room = SPEED * step - TUBE.least
        (x, y) = self.state.tolist()
        ways = (x - left, right - x, y - low, high - y)
        return [side for side, way in enumerate(ways) if way <= room]

    def _program(self, one: int, other: int, sides: list[int]) -> Choice:
        """Return the program of a choice, in positions, radii and risks: no inputs, and no binary variables."""
        n = STEPS
        x, y, radius, risk = (np.arange(n) + n * block for block in range(4))
        rows: list[Array] = []
        limits: list[float] = []

        def row(pairs: list[tuple[int, float]], limit: float) -> None:
            made = np.zeros(4 * n)
            for variable, factor in pairs:
                made[variable] += factor
            rows.append(made)
            limits.append(limit)

        for step in range(n):
            for axis, at in ((x, self.state[0]), (y, self.state[1])):
                for sign in (1.0, -1.0):
                    if step == 0:
                        row([(axis[0], sign)], SPEED + sign * float(at))
                    else:
                        row([(axis[step], sign), (axis[step - 1], -sign)], SPEED)
            row([(risk[step], -1.0), (radius[step], TUBE.chords[0][1])], -TUBE.chords[0][0])
        for at, (left, right, low, high) in ((one - 1, self.first), (other - 1, self.second)):
            row([(x[at], 1.0), (radius[at], 1.0)], right)
            row([(x[at], -1.0), (radius[at], 1.0)], -left)
            row([(y[at], 1.0), (radius[at], 1.0)], high)
            row([(y[at], -1.0), (radius[at], 1.0)], -low)
        left, right, low, high = self.wall
        for step, side in enumerate(sides):
            axis, sign, edge = ((x, 1.0, left), (x, -1.0, -right), (y, 1.0, low), (y, -1.0, -high))[side]
            row([(axis[step], sign), (radius[step], 1.0)], edge)
        row([(variable, 1.0) for variable in risk.tolist()], self.epsilon)
        return Choice(np.array(rows), np.array(limits))


def check(seed: int) -> bool:
    """Compare the planner with the enumeration; returns whether there is a plan."""
    errand = Errand.drawn(seed)
    best = errand.best()
    made, progress = planner(STEPS), Progress.beginning(errand.state)
    bid = made.bid(errand.commitment(), [], progress)
    plan = made.solve([errand.commitment()], progress)
    if best == np.inf:
        assert bid.cost is None
        assert bid.status == "infeasible"
        assert plan is None
        return False
    assert bid.cost == pytest.approx(best, abs=2e-6)
    assert plan is not None
    assert plan.cost == pytest.approx(best, abs=2e-6)
    return True


def test_a_bid_is_the_least_risk_over_all_choices() -> None:
    found = [check(seed) for seed in range(6)]
    assert any(found)
    assert not all(found)


@pytest.mark.slow
def test_bids_are_the_least_risk_over_all_choices_of_60_instances() -> None:
    found = [check(seed) for seed in range(60)]
    assert 10 <= sum(found) <= 50


def check_energy(seed: int) -> float | None:
    """Compare a plan with energy; return the excess of its cost over the best, None without a plan."""
    errand = Errand.drawn(seed)
    best = errand.best_with_energy()
    plan = planner(STEPS, energy=ENERGY).solve([errand.commitment()], Progress.beginning(errand.state))
    assert (plan is None) == (best == np.inf), seed
    if plan is None:
        return None
    assert plan.bound <= best + 2e-6, seed
    assert -2e-6 <= plan.cost - best <= BELOW + 2e-6, seed
    return plan.cost - best


def check_energies(count: int) -> None:
    found = [excess for seed in range(count) if (excess := check_energy(seed)) is not None]
    assert 0.2 * count <= len(found) < count
    # The squares are exact once the alternatives are chosen, so most plans are the best to the last digits.
    assert np.mean(np.array(found) < 2e-6) > 0.9


def test_a_plan_with_energy_is_the_best_of_all_choices() -> None:
    check_energies(6)


@pytest.mark.slow
def test_plans_with_energy_are_the_best_of_all_choices_of_60_instances() -> None:
    check_energies(60)


def test_a_specification_that_needs_more_than_its_epsilon_gets_no_bid() -> None:
    box, text = (-2.0, 2.0, -2.0, 2.0), "always[0, 5] inside(position, goal)"
    for epsilon, is_possible in ((0.05, True), (0.04, False)):
        offer = commitment(text, {"goal": box}, epsilon=epsilon)
        bid = Planner(DYNAMICS, TUBE, 5).bid(offer, [], Progress.beginning(np.zeros(2)))
        assert (bid.cost is not None) == is_possible


def test_a_plan_is_a_rollout_and_its_tube_keeps_to_what_is_required() -> None:
    box = (6.0, 8.5, -1.0, 1.0)
    goal = commitment("eventually[0, 5] inside(position, goal)", {"goal": box}, epsilon=3.0)
    plan = Planner(DYNAMICS, TUBE, 5).solve([goal], Progress.beginning(np.zeros(2)))
    assert plan is not None
    np.testing.assert_allclose(np.diff(plan.positions, axis=0), plan.inputs, atol=1e-9)
    assert np.abs(plan.inputs).max() <= SPEED
    inside = np.minimum(plan.positions - [6.0, -1.0], [8.5, 1.0] - plan.positions).min(axis=1)
    assert (inside - plan.radii).max() >= -1e-9
    np.testing.assert_array_less([TUBE.risk(radius) - 1e-8 for radius in plan.radii[1:]], plan.risks[1:])
    assert plan.cost >= plan.bound - 1e-6


def test_a_plan_is_kept_between_events_and_begins_where_the_robot_is() -> None:
    goal = commitment("eventually[0, 8] inside(position, goal)", {"goal": (6.0, 10.0, -2.0, 2.0)}, epsilon=1.0)
    made, progress = Planner(DYNAMICS, TUBE, 8), Progress.beginning(np.zeros(2))
    plan = made.solve([goal], progress)
    assert plan is not None
    moved = progress.after(plan.positions[1] + 0.1, float(plan.risks[1]))
    again = made.solve([goal], moved, plan, event=False)
    assert again is not None
    assert again.status == "followed"
    np.testing.assert_array_equal(again.positions[0], moved.states[1])
    assert again.positions[:, 0].max() >= 6.0 + TUBE.least


def test_the_risks_so_far_and_to_come_stay_within_epsilon() -> None:
    # 2.4 m wide: the widest tube does not fit, and a narrow one takes risk.
    text = "always[1, 4] inside(position, lane)"
    lane: dict[str, Box] = {"lane": (-20.0, 20.0, -1.2, 1.2)}
    progress = Progress.beginning(np.zeros(2))
    free = planner(4).bid(commitment(text, lane, epsilon=4.0), [], progress)
    assert free.cost == pytest.approx(4 * TUBE.risk(1.2), abs=1e-6)
    assert free.cost is not None
    assert planner(4).bid(commitment(text, lane, epsilon=free.cost + 1e-3), [], progress).cost == free.cost
    refused = planner(4).bid(commitment(text, lane, epsilon=free.cost - 1e-3), [], progress)
    assert refused.cost is None
    assert refused.status == "infeasible"


def test_risks_of_past_steps_do_not_make_a_later_return_infeasible() -> None:
    boxes: dict[str, Box] = {"pickup": (-5.0, 20.0, -5.0, 5.0), "home": (-5.0, 5.0, -5.0, 5.0)}
    used_up = commitment("always[0, 10] inside(position, pickup)", boxes, epsilon=0.5)
    home = commitment("eventually[0, 4] inside(position, home)", boxes, start=5, epsilon=0.1)
    progress = Progress.beginning(np.zeros(2))
    for _ in range(5):
        progress = progress.after(np.zeros(2), 0.3)
    made = Planner(DYNAMICS, TUBE, 10)
    assert made.bid(home, [used_up], progress).cost == pytest.approx(0.09)
    plan = made.solve([used_up, home], progress)
    assert plan is not None
    assert made.risk([used_up], progress, plan) == pytest.approx(1.55)
    assert made.risk([home], progress, plan) == pytest.approx(0.04)


def test_a_plan_that_cannot_be_made_again_is_followed_with_feedback() -> None:
    goal = commitment("eventually[0, 4] inside(position, goal)", {"goal": (6.0, 10.0, -2.0, 2.0)}, epsilon=1.0)
    plan = Planner(DYNAMICS, TUBE, 4).solve([goal], Progress.beginning(np.zeros(2)))
    assert plan is not None
    off = plan.positions[1] + [0.3, -0.2]
    np.testing.assert_allclose(plan.input_at(1, off, 0.5), plan.inputs[1] - [0.15, -0.1])
