"""Decides which cell to go to, by a strategy that is synthesised from knowledge about the environment."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.abstraction.knowledge_model import model_named
from symaware_cli.core import AgentGroup, GroupComponent, Level, Parameters, Quantity, Signal
from symaware_cli.specification import formula as stl
from symaware_cli.specification.columns import COLUMN_FUNCTIONS
from symaware_cli.specification.expression import FUNCTIONS
from symaware_cli.specification.formulation import Formulation, formulate
from symaware_cli.specification.node import Node, Temporal, walk
from symaware_cli.specification.parser import RESERVED, parse
from symaware_cli.specification.region import PlacedRegion
from symaware_cli.specification.scope import BeliefScope, World
from symaware_cli.specification.token import ExpressionError
from symaware_cli.synthesis.conflict import conflict
from symaware_cli.synthesis.fragment import clauses
from symaware_cli.synthesis.game import Game, Statement
from symaware_cli.synthesis.strategy import Strategy, UnrealisableError, synthesise
from symaware_cli.synthesis.vocabulary import CELL, Variable, Vocabulary
from symaware_cli.world.plugin import ParameterError
from symaware_cli.world.time import SECOND

Array = NDArray[np.float64]

PLAN = Signal(
    "plan",
    columns=(Quantity("cell", ""), Quantity("next_cell", ""), Quantity("goal", "")),
    description="the cell that the agent came to, the one that it goes to, and the number of the goal that it pursues",
)


class AgentInRegion(Parameters):
    """Whether another agent is in a region."""

    agent: str = Field(description="The id of the agent, such as `door`.")
    inside: str = Field(description="The name of the region.")


class AgentCell(Parameters):
    """The cell of another agent."""

    cell_of: str = Field(description="The id of the agent, such as `robot.1`.")


class StrategyMemory(NamedTuple):
    """What an agent remembers from turn to turn.

    Attributes:
        state: The state of the game at the last decision; -1 before the first one.
        goal: The goal that it pursues.
        following: The cell that it decided to go to.
        stands: Whether it has stopped, since an assumption was broken.
        values: The last known values of the environment's variables, in their order; -1 for none.
        met: When each goal of the environment was last met [ns].
        overdue: Whether each of these was reported to be overdue.
    """

    state: int
    goal: int
    following: int
    stands: bool
    values: tuple[int, ...]
    met: tuple[int, ...]
    overdue: tuple[bool, ...]


class _Report(NamedTuple):
    row: int
    name: str
    text: str
    level: Level
    data: Mapping[str, Any]


class KnowledgeStrategy(GroupComponent):
    """Chooses the next cell by a strategy that meets all guarantees while the environment keeps the assumptions.

    The strategy is synthesised before the run, from formulas in the fragment GR(1) about the cells of a knowledge
    model, and checked by a model checker. It advances at the turns at which the agent believes to be in the cell that
    it was going to; the environment is what the agent then believes about it. If the environment breaks an assumption,
    the agent stops in its cell.
    """

    signals = (PLAN,)
    events: ClassVar = {
        "strategy-made": "A strategy was made before the run; `digest` identifies it.",
        "goal-met": "An agent came to meet the goal that it pursued; `number` counts goals from 0.",
        "assumption-broken": "The environment did what the assumptions exclude; `assumptions` lists those it broke.",
        "assumption-overdue": "What is assumed to happen again and again did not happen within the patience.",
        "assumption-kept": "What was overdue happened.",
        "strategy-resumed": "An agent that had stopped goes on.",
        "cells-left": "An agent is neither in the cell that it came from nor in the one that it goes to.",
    }
    # Made from the parameters and the model before the run, and the same in each run of the scenario.
    uncaptured: ClassVar[Collection[str]] = ("_model", "_game", "_strategy", "_propositions", "_goals", "_regions")

    class Parameters(Parameters):
        """What is known about the environment, and what is to be achieved."""

        model: str = Field(description="The knowledge model, by its name under `knowledge_models`.")
        labels: dict[str, str | AgentInRegion | AgentCell] = Field(
            default_factory=dict,
            description="What formulas say about the environment, by name: a condition on what the agent believes, such"
            " as `knowledge.open > 0`; {agent: ID, inside: REGION}; or the cell of another agent, {cell_of: ID}.",
        )
        assumptions: tuple[str, ...] = Field((), description="What the environment is known to do, as formulas.")
        guarantees: tuple[str, ...] = Field(min_length=1, description="What the agent is to achieve, as formulas.")
        on_violation: Literal["stop", "resume"] = Field(
            "stop",
            description="What an agent does after the environment broke an assumption: it stays in its cell; or it goes"
            " on as soon as there is a way to meet the guarantees from where it is.",
        )
        patience: float | None = Field(
            None,
            gt=0,
            description="Time after which something that is assumed to happen again and again is reported as overdue"
            " [s]. By default it is not.",
        )

    def check(self, group: AgentGroup) -> None:
        """Make the strategy."""
        self._prepare(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Begin without a decision."""
        super().initialise_component(group)
        if not hasattr(self, "_strategy"):
            self._prepare(group)
        self._scope = BeliefScope(group, self.environment, [], {})
        roster = self.environment.roster
        for name, label in self.parameters.labels.items():
            other = "" if isinstance(label, str) else label.agent if isinstance(label, AgentInRegion) else label.cell_of
            if other and other not in roster:
                raise ValueError(f"the label `{name}` is about `{other}`, which is no agent")
        count = len(self._goals)
        start = StrategyMemory(
            -1, 0, -1, False, (-1,) * len(self._game.vocabulary.environment), (self.now,) * count, (False,) * count
        )
        self._memory = [start] * len(group)
        self._is_announced = False

    # Before the run

    def _prepare(self, group: AgentGroup) -> None:
        """Make the game and the strategy.

        Raises:
            ParameterError: A parameter is invalid.
        """
        given = self.parameters
        self._model = model = model_named(given.model, group.knowledge_models)
        self._regions = {
            name: PlacedRegion(name, group.regions, _nowhere)
            for name, region in group.regions.items()
            if region.around is None
        }
        self._propositions = {
            name: self._proposition(name, label, group)
            for name, label in given.labels.items()
            if isinstance(label, str)
        }
        try:
            vocabulary = Vocabulary(model.system, self._variables())
            stated = [self._statements(section, vocabulary) for section in ("assumptions", "guarantees")]
            self._game = Game(vocabulary, *stated)
        except ParameterError:
            raise
        except ValueError as error:  # names that clash, or a game that is too large
            raise ParameterError(str(error), ("labels",) if given.labels else ()) from None
        positions = group.model.positions(group.initial_state)
        cells = model.cells(positions)
        if (cells < 0).any():
            row = int(np.flatnonzero(cells < 0)[0])
            raise ValueError(f"{group.ids[row]} begins at {positions[row].tolist()}, which is in no cell")
        starts = sorted(set(cells.tolist()))
        try:
            self._strategy: Strategy = synthesise(self._game, starts)
        except UnrealisableError as error:
            raise self._unrealisable(error, starts) from None
        self._goals = self._game.goals(self._game.assumptions)

    def _variables(self) -> list[Variable]:
        system = self._model.system
        return [
            Variable(name, system if isinstance(label, AgentCell) else None)
            for name, label in self.parameters.labels.items()
        ]

    def _proposition(self, name: str, text: str, group: AgentGroup) -> Formulation:
        """Parse a condition on what an agent believes."""
        try:
            if not name.isidentifier() or name in RESERVED or name in COLUMN_FUNCTIONS:
                raise ParameterError(f"`{name}` cannot be a name in a formula", ("labels", name))
            scope = BeliefScope(group, cast("World", None), [], {})
            functions = {each: count for each, (count, _) in FUNCTIONS.items()}
            tree = parse(text, {*scope.names, *self._regions}, functions)
            _check_momentary(tree)
            return formulate(tree, SECOND)
        except ExpressionError as error:
            raise ParameterError(text, ("labels", name)) from error

    def _statements(self, section: Literal["assumptions", "guarantees"], vocabulary: Vocabulary) -> list[Statement]:
        found = []
        for number, text in enumerate(getattr(self.parameters, section)):
            try:
                found.append(Statement(text, clauses(text, vocabulary)))
            except ExpressionError as error:
                raise ParameterError(text, (section, number)) from error
        return found

    def _unrealisable(self, error: UnrealisableError, cells: Sequence[int]) -> ParameterError:
        """Explain that there is no strategy, at the last of the guarantees that contradict each other."""
        guilty = conflict(self._game, cells)
        texts = [each.text for each in guilty]
        if not texts:
            return ParameterError(f"there is no strategy: {error}", ("assumptions",))
        place = max(number for number, each in enumerate(self._game.guarantees) if any(each is one for one in guilty))
        said = " and ".join(f"`{text}`" for text in texts)
        together = "cannot be met" if len(texts) == 1 else "cannot be met together, though each part of them can"
        return ParameterError(
            f"there is no strategy: whatever the agent does, the environment can keep all assumptions and prevent it. "
            f"{said} {together}, for example from: {error}",
            ("guarantees", place),
        )

    # During the run

    def _compute(self) -> tuple[list[StrategyMemory], list[_Report]]:
        observed = self._observed()
        positions = self._group.model.positions(self._group.awareness.state)
        reports: list[_Report] = []
        memories = [
            self._decided(row, memory, positions[row], tuple(int(column[row]) for column in observed), reports)
            for row, memory in enumerate(self._memory)
        ]
        return memories, reports

    def _update(self, value: tuple[list[StrategyMemory], list[_Report]]) -> None:
        self._memory, reports = value
        if not self._is_announced:
            self._is_announced = True
            shape = self._game.shape
            text = f"made a strategy for {np.prod(shape):,} states and {len(self._strategy.choices)} goals"
            self.emit("strategy-made", text, digest=self._strategy.digest)
        for row, name, text, level, data in reports:
            self.emit_for(row, name, text, level=level, **data)
        cells = self._game.values[CELL]
        plan = np.array(
            [
                [cells[each.state], each.following, each.goal] if each.state >= 0 else [np.nan] * 3
                for each in self._memory
            ],
            float,
        )
        self.record(PLAN, plan)

    def _observed(self) -> list[NDArray[np.intp]]:
        """Return what the agents believe about each variable of the environment; -1 where they believe nothing."""
        found = []
        for name, label in self.parameters.labels.items():
            if isinstance(label, str):
                formulation = self._propositions[name]
                with np.errstate(all="ignore"):
                    each = [np.asarray(atom.robustness(self._look_up)) for atom in formulation.atoms]
                truth = _holds(formulation.formula, each)
                found.append(np.broadcast_to(truth, (len(self._group),)).astype(np.intp))
                continue
            positions = self._believed(label.agent if isinstance(label, AgentInRegion) else label.cell_of)
            known = np.isfinite(positions).all(axis=1)
            values = np.full(len(positions), -1, np.intp)
            if known.any():
                if isinstance(label, AgentCell):
                    values[known] = self._model.cells(positions[known])
                else:
                    values[known] = self._regions[label.inside].robustness(positions[known]) > 0.0
            found.append(values)
        return found

    def _look_up(self, name: str) -> Any:
        return self._regions[name] if name in self._regions else self._scope.look_up(name)

    def _believed(self, other: str) -> Array:
        """Return where each agent believes another one to be [m], NaN where it believes nothing; shape (n, d)."""
        awareness, index = self._group.awareness, self.environment.roster.index(other)
        tracks, world = awareness.tracks, awareness.world
        positions = np.full((len(self._group), 2), np.nan)
        if tracks is not None:
            rows = np.flatnonzero(tracks.others == index)
            positions[tracks.observers[rows]] = tracks.positions[rows, :2]
        elif world is not None:
            positions[:] = world.positions[index, :2]
        return positions

    def _decided(
        self, row: int, memory: StrategyMemory, position: Array, observed: tuple[int, ...], reports: list[_Report]
    ) -> StrategyMemory:
        """Return the memory of an agent after its turn."""
        observed = tuple(last if new < 0 else new for new, last in zip(observed, memory.values, strict=True))
        memory = memory._replace(values=observed)
        if min(observed, default=0) < 0:
            return memory  # nothing can be decided until something is believed about everything
        game, model = self._game, self._model
        if memory.state < 0:
            cell = int(model.cells(position[None])[0])
        else:
            if not model.contains(memory.following, position):
                if not model.contains(int(game.values[CELL][memory.state]), position):
                    reports.append(_Report(row, "cells-left", "left its cells", Level.WARNING, {}))
                return memory
            cell = memory.following
        names = [each.name for each in game.vocabulary.environment]
        after = {name: np.array([value]) for name, value in zip(names, observed, strict=True)}
        after[CELL] = np.array([cell])
        broken = self._broken(memory, after)
        before, state = memory.state, self._state(memory, after)
        memory = self._reminded(row, memory, state, reports)
        if broken:
            text = f"the environment broke {' and '.join(f'`{each}`' for each in broken)}"
            reports.append(_Report(row, "assumption-broken", text, Level.WARNING, {"assumptions": broken}))
        stands = bool(broken) or memory.stands
        if stands and self.parameters.on_violation == "resume" and self._strategy.covers(state):
            if memory.stands:
                reports.append(_Report(row, "strategy-resumed", "goes on", Level.INFO, {}))
            stands = False
        if stands or not self._strategy.covers(state):
            return memory._replace(state=state, following=cell, stands=True)
        following, goal = self._strategy.choice(state, memory.goal)
        number = memory.goal
        if self._strategy.reached[number, state] and not (before >= 0 and self._strategy.reached[number, before]):
            reports.append(_Report(row, "goal-met", f"met goal {number}", Level.INFO, {"number": number}))
        return memory._replace(state=state, goal=goal, following=following, stands=False)

    def _state(self, memory: StrategyMemory, after: Mapping[str, NDArray[np.intp]]) -> int:
        game = self._game
        if memory.state < 0:
            return int(game.starting(after)[0])
        bits = [bit.updated(each[[memory.state]], after) for bit, each in zip(game.bits, game.bit_values, strict=True)]
        return int(game.index(after, bits)[0])

    def _broken(self, memory: StrategyMemory, after: Mapping[str, NDArray[np.intp]]) -> list[str]:
        """Return the assumptions that the last step of the environment broke."""
        game = self._game
        if memory.state < 0:
            return [each.text for each in game.assumptions if not game.holds_at_start([each], after)[0]]
        now = {name: each[[memory.state]] for name, each in game.values.items()}
        broken = [
            f"{variable.name} moves from cell to cell"
            for variable in game.vocabulary.environment
            if after[variable.name][0] not in variable.following[now[variable.name][0]]
        ]
        for each in game.assumptions:
            for evaluate, ahead in game.safety([each]):
                if not np.all(evaluate(now, after) if ahead else evaluate(after, None)):
                    broken.append(each.text)
                    break
        return broken

    def _reminded(self, row: int, memory: StrategyMemory, state: int, reports: list[_Report]) -> StrategyMemory:
        """Note which goals the environment meets, and report those that are overdue."""
        met = tuple(self.now if goal[state] else last for goal, last in zip(self._goals, memory.met, strict=True))
        patience = self.parameters.patience
        if patience is None:
            return memory._replace(met=met)
        overdue = tuple(self.now - last > patience * SECOND for last in met)
        texts = [
            each.text
            for each in self._game.assumptions
            for one in each.clauses
            if one.kind not in ("initial", "safety")
        ]
        for text, late, known in zip(texts, overdue, memory.overdue, strict=True):
            if late and not known:
                said = f"`{text}` is overdue: nothing for {patience:g} s"
                reports.append(_Report(row, "assumption-overdue", said, Level.WARNING, {"assumption": text}))
            elif known and not late:
                reports.append(_Report(row, "assumption-kept", f"`{text}` was met", Level.INFO, {"assumption": text}))
        return memory._replace(met=met, overdue=overdue)


def _holds(formula: stl.Formula, values: Sequence[Array]) -> Any:
    """Return whether a formula about one instant holds, from the encoded robustness of its predicates."""
    match formula:
        case stl.Constant(value=value):
            return np.bool_(value)
        case stl.Predicate(index=index):
            return values[index] > 0.0
        case stl.Not(operand=operand):
            return ~_holds(operand, values)
        case stl.And(operands=operands):
            return np.logical_and.reduce(np.broadcast_arrays(*(_holds(each, values) for each in operands)))
        case stl.Or(operands=operands):
            return np.logical_or.reduce(np.broadcast_arrays(*(_holds(each, values) for each in operands)))
    raise TypeError(f"{type(formula).__name__} is not about one instant")


def _check_momentary(tree: Node) -> None:
    for node in walk(tree):
        if isinstance(node, Temporal):
            raise ExpressionError(f"`{node.operator}` belongs in a formula: a label is about one instant", node.span)


def _nowhere(agent: str) -> tuple[Array, float | None]:
    raise ValueError(f"the region moves with `{agent}`")
