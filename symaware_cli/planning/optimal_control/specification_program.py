"""Plans of a linear model that satisfy specifications: signal temporal logic as a mixed-integer linear program.

The robustness of each specification has a lower bound, and may be maximised: V. Raman et al., "Model predictive control
with signal temporal logic specifications", CDC 2014. Only alternatives have binary variables (C. Belta and
S. Sadraddini, "Formal methods for control synthesis: an optimization perspective", Annual Review of Control, Robotics,
and Autonomous Systems 2, 2019): one each, or a number that is logarithmic in theirs (V. Kurtz and H. Lin,
"Mixed-integer programming for signal temporal logic with fewer binary variables", IEEE Control Systems Letters 6,
2022). Half spaces that cannot be reached in time, or cannot be left, are omitted; the other constants of the program
are as tight as reachability makes them.

Reasons: docs/decisions/0036-plans-for-specifications.md
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.geometry import Array, Indices
from symaware_cli.planning.optimal_control.affine_predicate import Face, StateSet, margin
from symaware_cli.planning.optimal_control.formula_tree import (
    FALSE,
    TRUE,
    Combination,
    FormulaTree,
    KnownMargin,
    Leaf,
    PredicateSets,
)
from symaware_cli.planning.optimal_control.linear_dynamics import LinearDynamics
from symaware_cli.planning.optimal_control.mixed_integer_program import (
    MixedIntegerProgram,
    MixedIntegerSolution,
    Status,
)
from symaware_cli.specification import formula as stl

#: How alternatives are told apart: by a binary variable each, or by a logarithmic number.
Alternatives = Literal["binary", "logarithmic"]

#: Returns the reduction of the margin of a half space at an instant, for noise.
Reduction = Callable[[Face, int], float]

#: How much bounds of reachable states are widened, against rounding.
_SLACK = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class SpecificationPlan:
    """A plan, or why there is none.

    Attributes:
        status: As of `MixedIntegerSolution`.
        states: The states from the present on, shape (N + 1, nx); None without a plan.
        inputs: The control inputs, shape (N, nu); None without a plan.
        robustness: The robustness of each specification on the states so far and to come, as if nothing came after
            them: the monitor's, or a lower bound of it where it is positive (see `predicate_sets`).
        solution: The solution of the program.
    """

    status: Status
    states: Array | None
    inputs: Array | None
    robustness: Mapping[str, float]
    solution: MixedIntegerSolution


class ProgramSize(NamedTuple):
    """The size of a mixed-integer program.

    Attributes:
        binaries: The number of binary variables: alternatives.
        rows: The number of rows.
        entries: The number of coefficients in them.
    """

    binaries: int
    rows: int
    entries: int

    def seconds(self, nodes: int) -> float:
        """Return about how much CPU time a search takes at most [s].

        A node of the tree takes about 1.1 us for each coefficient: measured on programs of 1,000 to 20,000, a fifth of
        which took between 0.8 and 1.8 of that with the others far below, as their searches ended at the first nodes.

        Args:
            nodes: The limit of nodes.
        """
        return 1.1e-6 * self.entries * nodes if self.binaries else 0.0


@dataclass(slots=True, eq=False)
class _Requirement:
    """A specification of a program."""

    name: str
    tree: FormulaTree
    exact: FormulaTree
    root: int
    greatest: float
    least: float
    scale: float
    reduction: Reduction | None
    literals: dict[int, int]
    alternatives: list[_Alternatives]


@dataclass(frozen=True, slots=True)
class _Alternatives:
    """The logarithmic encoding of "any of": which part has which share, and the binary digits of the part chosen."""

    parts: tuple[int, ...]
    literal: int | None
    digits: Indices


def margins(sets: Sequence[tuple[StateSet, StateSet]], states: Array) -> list[Array]:
    """Return the robustness of predicates on known states, shape (k, nx), as `SpecificationProgram.require` needs it.

    Args:
        sets: Of each predicate the states in which it holds, and those in which its negation does.
        states: The states.

    Returns:
        For each predicate an array of shape (k,).
    """
    found = []
    for positive, negative in sets:
        holds = np.array([margin(positive, state) for state in states])
        fails = np.array([margin(negative, state) for state in states])
        found.append(np.where(holds >= 0.0, holds, -fails))
    return found


class SpecificationProgram:
    """Plans control inputs from the present on, such that specifications hold.

    Instants are counted from the present, which is instant 0. Further constraints of a plan may be added to `program`,
    over the variables `states` and `inputs`.

    Attributes:
        program: The mixed-integer program.
        states: The variables of the states, from the present on; shape (N + 1, nx).
        inputs: The variables of the control inputs; shape (N, nu). Held inputs have the same variables.
        steps: The number of steps to plan, N.
    """

    def __init__(
        self,
        dynamics: LinearDynamics,
        state: ArrayLike,
        steps: int,
        *,
        hold: int = 1,
        disturbance: Array | None = None,
        lower: ArrayLike = -np.inf,
        upper: ArrayLike = np.inf,
        robustness_weight: float = 0.0,
        alternatives: Alternatives = "binary",
    ) -> None:
        """Begin a program.

        Args:
            dynamics: The dynamics, with limited control inputs.
            state: The present state; shape (nx,).
            steps: The number of steps to plan, N.
            hold: The number of steps for which each control input is held.
            disturbance: The known disturbance added to the state in each step, shape (N, nx).
            lower: Lower bounds of the states after the present; shape (nx,).
            upper: Upper bounds of them.
            robustness_weight: The reward for robustness beyond the bounds, for the specification with the least excess.
            alternatives: The encoding of alternatives: by a binary variable each, or by logarithmically many.

        Raises:
            ValueError: Neither control inputs nor states are limited.
        """
        self.program = MixedIntegerProgram()
        self._state: Array = np.array(state, float)
        size = len(self._state)
        self._dynamics = dynamics
        self._disturbance = np.zeros((steps, size)) if disturbance is None else disturbance
        self._alternatives = alternatives
        self._robustness_weight = robustness_weight
        self._robustness: int | None = None
        self._encoded = False
        self.steps = steps
        self._lower = np.broadcast_to(np.asarray(lower, float), (size,))
        self._upper = np.broadcast_to(np.asarray(upper, float), (size,))
        self._bounds: dict[tuple[float, ...], tuple[Array, Array]] = {}
        self._requirements: list[_Requirement] = []
        self._radii: dict[int, tuple[int, float, float]] = {}
        self._lengths: dict[tuple[float, ...], float] = {}
        reach = [self._reach(tuple(unit.tolist())) for unit in np.eye(size)]
        low, high = (np.array([each[side] for each in reach]).T for side in (0, 1))
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise ValueError("a plan needs limits of the control input, or of the states")
        self.states: Indices = self.program.add_variables((steps + 1) * size, low.ravel(), high.ravel()).reshape(
            -1, size
        )
        count = -(-steps // hold)
        inputs = [
            self.program.add_variables(len(dynamics.least), dynamics.least, dynamics.greatest) for _ in range(count)
        ]
        for each in inputs:
            for normal, limit in zip(dynamics.normals, dynamics.limits, strict=True):
                self.program.add_row(each.tolist(), normal.tolist(), upper=float(limit))
        self.inputs: Indices = np.array([inputs[step // hold] for step in range(steps)], np.intp).reshape(
            steps, len(dynamics.least)
        )
        self._add_dynamics()

    def require(
        self,
        name: str,
        formula: stl.Formula,
        sets: Sequence[PredicateSets],
        *,
        least: float = 0.0,
        scale: float = 1.0,
        first: int = 0,
        last: int | None = None,
        past: Sequence[Array] = (),
        reduction: Reduction | None = None,
        open_future: bool = False,
    ) -> bool:
        """Require that a specification holds.

        At instants that are known, a predicate that holds by less than the least robustness counts as held: it cannot
        be improved.

        Args:
            name: The name of the specification.
            formula: Its formula, in steps of the dynamics.
            sets: Of each predicate the states in which it holds, and those in which its negation does (see
                `predicate_sets`), or a function of the instant that returns them (see `pair_sets`).
            least: The least robustness, not negative.
            scale: The robustness that is worth as much as 1 of others; 0 if more than the least is worth nothing.
            first: The instant that the formula is about; negative in the past.
            last: The last instant that counts; None for the end of the plan.
            past: The robustness of each predicate from the instant `first` to the last one before the present; each of
                shape (-first,). Needed if that lies in the past: see `margins`.
            reduction: Returns the reduction of margins at future instants.
            open_future: Whether requirements beyond the plan count as satisfied, instead of being left out.

        Returns:
            Whether it may hold; False if past values or the bounds of reachable states rule it out, so that the program
            is infeasible.
        """

        def leaf(half_space: Face, instant: int) -> Leaf | KnownMargin:
            return Leaf(half_space, instant) if instant > 0 else KnownMargin(self._margin(half_space, self._state))

        def settled(margin: float) -> KnownMargin | bool:
            return False if margin < 0.0 else KnownMargin(margin) if margin >= least else True

        def known(index: int, instant: int) -> float | None:
            return float(past[index][instant - first]) if instant < 0 else None

        end = self.steps if last is None else min(last, self.steps)
        tree = FormulaTree(formula, sets, first, end, leaf, settled, known, open_future)
        exact = FormulaTree(formula, sets, first, end, leaf, KnownMargin, known)
        greatest = np.inf if self._robustness_weight and scale else least
        made = _Requirement(name, tree, exact, tree.root, greatest, least, scale, reduction, {}, [])
        if greatest > least:
            made.greatest = max(least, tree.value(tree.root, lambda leaf: self._leaf_bounds(made, leaf)[1]))
        made.root = self._simplified(made)
        self._requirements.append(made)
        return made.root != FALSE

    def add_radius(self, instant: int, variable: int, least: float, greatest: float) -> None:
        """Make a variable the radius of a tube at an instant: the distance from the plan within which states may lie.

        Call it before `require`.

        Args:
            instant: The instant, after the present.
            variable: The variable.
            least: Its least value.
            greatest: Its greatest.
        """
        self._radii[instant] = (variable, least, greatest)

    def add_effort(self, weight: float, tangents: int = 9) -> None:
        """Add the squares of all control inputs to the cost, times a weight; see `MixedIntegerProgram.add_square`."""
        low, high = self._dynamics.least.tolist(), self._dynamics.greatest.tolist()
        variables, counts = np.unique(self.inputs, return_counts=True)
        columns = {int(variable): column for row in self.inputs for column, variable in enumerate(row)}
        for variable, count in zip(variables.tolist(), counts.tolist(), strict=True):
            column = columns[variable]
            self.program.add_square(variable, weight * count, low[column], high[column], tangents)

    def solve(
        self, *, nodes: int = 10_000, gap: float = 1e-6, guess: Array | None = None, refine: bool = True
    ) -> SpecificationPlan:
        """Solve the program.

        Args:
            nodes: The greatest number of nodes of the tree.
            gap: The gap at which a plan counts as optimal, in the unit of the cost.
            guess: States from the present on to begin with, shape (N + 1, nx), such as those of the last plan.
            refine: Whether to solve it again with squares in place of their tangents, and the alternatives fixed.
        """
        self._encode()
        start = None if guess is None else self.choices(guess)
        solution = self.program.solve(nodes=nodes, gap=gap, start=start)
        return self.refined(self._plan(solution)) if refine else self._plan(solution)

    def refined(self, plan: SpecificationPlan, tolerance: float = 1e-7) -> SpecificationPlan:
        """Solve the program with the alternatives of one of its plans, and squares in place of their tangents.

        Args:
            plan: A plan of this program.
            tolerance: By how much the cost of squares may exceed that of their tangents.

        Returns:
            The new plan; the given one if there is nothing to improve.
        """
        solution = plan.solution
        if solution.values is None or not self.program.has_squares:
            return plan
        found = self.program.refined(solution.values[self.program.integers], tolerance)
        if found.values is None:
            return plan
        bound = min(solution.bound, found.cost)
        return self._plan(MixedIntegerSolution(solution.status, found.values, found.cost, bound, solution.nodes))

    def solve_as_chosen(self, guess: Array, tolerance: float = 1e-7) -> SpecificationPlan:
        """Solve the program with the alternatives that states choose, without a search.

        Args:
            guess: States from the present on, shape (N + 1, nx).
            tolerance: By how much the cost of squares may exceed that of their tangents.
        """
        return self._plan(self.program.refined(self.choices(guess), tolerance))

    def choices(self, guess: Array) -> Array:
        """Return values of the integer variables that suit states from the present on, shape (N + 1, nx)."""
        self._encode()
        values = np.zeros(self.program.variables)
        for made in self._requirements:
            memory: dict[int, float] = {}

            def margin_of(leaf: Leaf, of: _Requirement = made) -> float:
                return self._margin(leaf.half_space, guess[leaf.instant]) - self._reduced(of, leaf)[0]

            waiting = [made.root]
            while waiting:
                node = made.tree[waiting.pop()]
                if isinstance(node, Combination):
                    best = node.parts
                    if not node.every:
                        best = (max(node.parts, key=lambda part: made.tree.value(part, margin_of, memory)),)
                    for part in best:
                        if part in made.literals and not node.every:
                            values[made.literals[part]] = 1.0
                        waiting.append(part)
            for each in made.alternatives:
                self._choose(made, each, values, memory, margin_of)
        return values[self.program.integers]

    @property
    def size(self) -> ProgramSize:
        """The size of the program, with the rows of the specifications."""
        self._encode()
        return ProgramSize(len(self.program.integers), self.program.rows, self.program.entries)

    # Half spaces

    @property
    def leaves(self) -> list[Leaf]:
        """The half spaces at instants to come that the specifications refer to, each once."""
        return list(dict.fromkeys(leaf for made in self._requirements for leaf in made.tree.leaves))

    @property
    def most_required(self) -> int:
        """The greatest number of half spaces that have to hold together, over all alternatives."""
        return sum(made.tree.most_required(made.tree.root) for made in self._requirements)

    def cheapest(self, costs: Mapping[Leaf, float]) -> list[Leaf]:
        """Return half spaces in which all specifications hold: those of the alternatives with the least sum of costs.

        Args:
            costs: The cost of each of the `leaves`.
        """
        found = [leaf for made in self._requirements for leaf in made.tree.cheapest(made.tree.root, costs)]
        return list(dict.fromkeys(found))

    # Rows

    def _encode(self) -> None:
        """Add the rows of the specifications, as tight as the greatest robustness that all of them can have allows."""
        if self._encoded:
            return
        self._encoded = True
        rewarded = [made for made in self._requirements if made.greatest > made.least]
        if self._robustness_weight and len(rewarded):
            most = min((made.greatest - made.least) / made.scale for made in self._requirements if made.scale)
            if 0.0 < most < np.inf:
                (self._robustness,) = self.program.add_variables(1, 0.0, most, -self._robustness_weight).tolist()
            for made in rewarded:
                made.greatest = made.least + (made.scale * most if most < np.inf else 0.0)
                made.root = self._simplified(made)
        for made in self._requirements:
            if made.root == FALSE:
                self.program.add_row([], [], lower=1.0)
            elif made.root != TRUE:
                self._require(made, made.root, None)

    def _simplified(self, made: _Requirement) -> int:
        """Return the node of a requirement without what cannot be chosen, or cannot fail."""
        least, greatest = made.least - _SLACK, made.greatest
        return made.tree.simplified(made.tree.root, least, greatest, lambda leaf: self._leaf_bounds(made, leaf))

    def _add_dynamics(self) -> None:
        A, B, c = self._dynamics.A, self._dynamics.B, self._dynamics.c
        for step in range(self.steps):
            now, after, inputs = self.states[step].tolist(), self.states[step + 1].tolist(), self.inputs[step].tolist()
            for row in range(len(now)):
                offset = float(c[row] + self._disturbance[step, row])
                coefficients = [1.0, *(-A[row]).tolist(), *(-B[row]).tolist()]
                self.program.add_row([after[row], *now, *inputs], coefficients, offset, offset)

    def _require(self, made: _Requirement, number: int, literal: int | None) -> None:
        """Require a node, or that it holds if a binary variable is 1."""
        match made.tree[number]:
            case Leaf() as leaf:
                reduction, radius, length = self._reduced(made, leaf)
                variables, coefficients = self.states[leaf.instant].tolist(), list(leaf.half_space.normal)
                if radius is not None:
                    variables.append(radius)
                    coefficients.append(-length)
                low = self._leaf_bounds(made, leaf)[0]
                self._add_margin(made, variables, coefficients, leaf.half_space.offset - reduction, low, literal)
            case KnownMargin(margin=value):
                self._add_margin(made, [], [], value, value, literal)
            case Combination(every=True, parts=parts):
                for part in parts:
                    self._require(made, part, literal)
            case Combination(every=False, parts=parts):
                self._add_alternatives(made, parts, literal)

    def _add_margin(
        self,
        made: _Requirement,
        variables: list[int],
        coefficients: list[float],
        offset: float,
        low: float,
        literal: int | None,
    ) -> None:
        """Require a margin of a sum of variables and an offset, which is never below a bound."""
        least = made.least - offset
        if self._robustness is not None and made.greatest > made.least:
            variables, coefficients = [*variables, self._robustness], [*coefficients, -made.scale]
        if literal is not None:
            # If it is not chosen, the row holds for all reachable states.
            slack = max(0.0, made.greatest - low)
            variables, coefficients = [*variables, literal], [*coefficients, -slack]
            least -= slack
        self.program.add_row(variables, coefficients, lower=least)

    def _add_alternatives(self, made: _Requirement, parts: tuple[int, ...], literal: int | None) -> None:
        binary = self._alternatives == "binary"
        chosen = []
        for part in parts:
            if part not in made.literals:
                (variable,) = self.program.add_variables(1, 0.0, 1.0, integer=binary).tolist()
                made.literals[part] = variable
                self._require(made, part, variable)
            chosen.append(made.literals[part])
        if binary:
            if literal is None:
                self.program.add_row(chosen, [1.0] * len(chosen), lower=1.0)
            else:
                self.program.add_row([*chosen, literal], [*[1.0] * len(chosen), -1.0], lower=0.0)
            return
        # A special ordered set of type 1: one of the shares is 1, and binary digits tell which.
        count = len(parts) + (literal is not None)
        shares = self.program.add_variables(count, 0.0, 1.0).tolist()
        self.program.add_row(shares, [1.0] * count, 1.0, 1.0)
        for variable, share in zip(chosen, shares, strict=False):
            self.program.add_row([variable, share], [1.0, -1.0], lower=0.0)
        if literal is not None:
            self.program.add_row([shares[-1], literal], [1.0, 1.0], 1.0, 1.0)
        digits = self.program.add_variables((count - 1).bit_length(), 0.0, 1.0, integer=True)
        for place, digit in enumerate(digits.tolist()):
            one = [share for number, share in enumerate(shares) if number >> place & 1]
            other = [share for number, share in enumerate(shares) if not number >> place & 1]
            self.program.add_row([*one, digit], [*[1.0] * len(one), -1.0], upper=0.0)
            self.program.add_row([*other, digit], [1.0] * (len(other) + 1), upper=1.0)
        made.alternatives.append(_Alternatives(parts, literal, digits))

    # Margins

    def _reduced(self, made: _Requirement, leaf: Leaf) -> tuple[float, int | None, float]:
        """Return how much the margin of a leaf is reduced, and the variable and factor by which it is further."""
        fixed = made.reduction(leaf.half_space, leaf.instant) if made.reduction is not None else 0.0
        if leaf.instant not in self._radii:
            return fixed, None, 0.0
        return fixed, self._radii[leaf.instant][0], self._length(leaf.half_space.normal)

    def _length(self, normal: tuple[float, ...]) -> float:
        if normal not in self._lengths:
            self._lengths[normal] = float(np.sqrt(np.array(normal) @ normal))
        return self._lengths[normal]

    def _leaf_bounds(self, made: _Requirement, leaf: Leaf) -> tuple[float, float]:
        """Return bounds of the margin of a leaf, over all plans."""
        low, high = self._reach(leaf.half_space.normal)
        fixed, radius, length = self._reduced(made, leaf)
        least, most = self._radii[leaf.instant][1:] if radius is not None else (0.0, 0.0)
        stage, offset = leaf.instant, leaf.half_space.offset - fixed
        return float(low[stage]) + offset - length * most, float(high[stage]) + offset - length * least

    def _reach(self, normal: tuple[float, ...]) -> tuple[Array, Array]:
        """Return bounds of a linear function of the states from the present on; each of shape (N + 1,)."""
        if normal not in self._bounds:
            row = np.array(normal)
            low, high = self._dynamics.reach(row, self._state, self.steps, self._disturbance)
            used = row != 0.0
            ends = row[used, None] * np.stack([self._lower[used], self._upper[used]], axis=1)
            low[1:], high[1:] = (
                np.maximum(low[1:], ends.min(axis=1).sum()) - _SLACK,
                np.minimum(high[1:], ends.max(axis=1).sum()) + _SLACK,
            )
            self._bounds[normal] = low, high
        return self._bounds[normal]

    @staticmethod
    def _margin(half_space: Face, state: Array) -> float:
        return float(np.array(half_space.normal) @ state) + half_space.offset

    # Results

    def _choose(
        self,
        made: _Requirement,
        each: _Alternatives,
        values: Array,
        memory: dict[int, float],
        margin_of: Callable[[Leaf], float],
    ) -> None:
        """Set the digits of alternatives to those of the best part."""
        worths = [made.tree.value(part, margin_of, memory) for part in each.parts]
        best = int(np.argmax(worths))
        if each.literal is not None and worths[best] < made.least:
            best = len(each.parts)
        for place, digit in enumerate(each.digits.tolist()):
            values[digit] = float(best >> place & 1)

    def _plan(self, solution: MixedIntegerSolution) -> SpecificationPlan:
        if solution.values is None:
            return SpecificationPlan(solution.status, None, None, {}, solution)
        inputs = np.clip(solution.values[self.inputs], self._dynamics.least, self._dynamics.greatest)
        states = [self._state]
        for step, control_input in enumerate(inputs):
            states.append(self._dynamics.after(states[-1], control_input) + self._disturbance[step])
        robustness = {
            made.name: made.exact.value(
                made.exact.root, lambda leaf: self._margin(leaf.half_space, states[leaf.instant])
            )
            for made in self._requirements
        }
        return SpecificationPlan(solution.status, np.array(states), inputs, robustness, solution)
