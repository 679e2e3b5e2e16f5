"""Decides which cell to go to, by a strategy that is synthesised from knowledge about the environment."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.components.knowledge_game import GameParameters, KnowledgeGame
from symaware_cli.core import AgentGroup, GroupComponent, Level, Quantity, Signal
from symaware_cli.specification.scope import BeliefScope
from symaware_cli.synthesis.attempt import attempt
from symaware_cli.synthesis.conflict import conflict
from symaware_cli.synthesis.counterstrategy import Counterstrategy, oppose
from symaware_cli.synthesis.environment_cells import EnvironmentCells
from symaware_cli.synthesis.fragment import LIVENESS
from symaware_cli.synthesis.game import Statement
from symaware_cli.synthesis.strategy import Strategy, UnrealisableError, synthesise
from symaware_cli.synthesis.strategy_cache import StrategyCache, encoded
from symaware_cli.synthesis.vocabulary import CELL
from symaware_cli.world.plugin import ParameterError
from symaware_cli.world.time import SECOND

Array = NDArray[np.float64]

PLAN = Signal(
    "plan",
    columns=(Quantity("cell", ""), Quantity("next_cell", ""), Quantity("goal", "")),
    description="the cell that the agent came to, the one that it goes to, and the number of the goal that it pursues",
)
ENVIRONMENT = Signal(
    "environment",
    "table",
    [*(Quantity(each, "m") for each in ("x_low", "x_high", "y_low", "y_high")), Quantity("crossed", "1")],
    drawn="boxes",
    description="cells of others as believed or played; and, crossed, those that the environment closes to the agent",
)


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
        opposing: The goal that the environment pursues, if it plays a counterstrategy.
    """

    state: int
    goal: int
    following: int
    stands: bool
    values: tuple[int, ...]
    met: tuple[int, ...]
    overdue: tuple[bool, ...]
    opposing: int = 0


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

    signals = (PLAN, ENVIRONMENT)
    events: ClassVar = {
        "strategy-made": "A strategy was made before the run; `digest` identifies it.",
        "counterstrategy-made": "There is no strategy; the environment plays a counterstrategy.",
        "environment-moved": "The environment took a step of its counterstrategy.",
        "guarantee-broken": "The environment has won: the agent had no choice that keeps its guarantees.",
        "goal-met": "An agent came to meet the goal that it pursued; `number` counts goals from 0.",
        "assumption-broken": "The environment did what the assumptions exclude; `assumptions` lists those it broke.",
        "assumption-overdue": "What is assumed to happen again and again did not happen within the patience.",
        "assumption-kept": "What was overdue happened.",
        "strategy-resumed": "An agent that had stopped goes on.",
        "cells-left": "An agent is neither in the cell that it came from nor in the one that it goes to.",
    }
    # Made from the parameters and the model before the run, and the same in each run of the scenario.
    uncaptured: ClassVar[Collection[str]] = (
        "_knowledge",
        "_game",
        "_strategy",
        "_counterstrategy",
        "_goals",
        "_cells",
    )

    class Parameters(GameParameters):
        """What is known about the environment, what is to be achieved, and what to do otherwise."""

        on_unrealisable: Literal["refuse", "counterstrategy"] = Field(
            "refuse",
            description="What to do if there is no strategy: refuse the scenario, with the reason; or run it with an"
            " environment that plays a counterstrategy instead of what is believed, to watch how it wins.",
        )
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
        self._knowledge.check_others(self.environment.roster)
        count = len(self._goals)
        start = StrategyMemory(
            -1, 0, -1, False, (-1,) * len(self._game.vocabulary.environment), (self.now,) * count, (False,) * count
        )
        self._memory = [start] * len(group)
        self._is_announced = False

    # Before the run

    def attachments(self) -> Mapping[str, bytes]:
        """Return the strategy."""
        return {"strategy": encoded(self._strategy)}

    @property
    def awaited(self) -> Mapping[int, set[str]]:
        """The agents that something is assumed of to happen again and again, by the number of the assumption."""
        return self._knowledge.awaited if hasattr(self, "_knowledge") else {}

    def _prepare(self, group: AgentGroup) -> None:
        """Make the game and the strategy.

        Raises:
            ParameterError: A parameter is invalid.
        """
        self._knowledge = KnowledgeGame(self.parameters, group)
        self._game = game = self._knowledge.game
        self._goals = game.goals(game.assumptions)
        self._cells = EnvironmentCells(game, self._knowledge.model)
        self._counterstrategy: Counterstrategy | None = None
        try:
            self._strategy: Strategy = synthesise(game, self._knowledge.starts, StrategyCache.of_user())
        except UnrealisableError as error:
            if self.parameters.on_unrealisable == "refuse" or not game.starts(self._knowledge.starts)[1].any():
                raise self._unrealisable(error) from None
            self._counterstrategy, self._strategy = oppose(game), attempt(game)

    def _unrealisable(self, error: UnrealisableError) -> ParameterError:
        """Explain that there is no strategy, at each of the formulas that contradict each other."""
        guilty = conflict(self._game, self._knowledge.starts)
        if not guilty.guarantees:
            return ParameterError(f"there is no strategy: {error}", ("assumptions",))
        *others, last = [
            *_places("assumptions", self._game.assumptions, guilty.assumptions),
            *_places("guarantees", self._game.guarantees, guilty.guarantees),
        ]
        said = " and ".join(f"`{each.text}`" for each in guilty.guarantees)
        together = "cannot be met" if not others else "cannot be met together, though each part of them can"
        if guilty.assumptions:
            under = " and ".join(f"`{each.text}`" for each in guilty.assumptions)
            together = f"cannot be met under {under}, which the agent must not make impossible to keep"
        return ParameterError(
            f"there is no strategy: whatever the agent does, the environment can keep all assumptions and prevent it. "
            f"{said} {together}, for example from: {error}. With `on_unrealisable: counterstrategy` the environment "
            f"shows in a run how",
            last,
            related=[(place, "this is a part of the conflict") for place in others],
        )

    # During the run

    def _compute(self) -> tuple[list[StrategyMemory], list[_Report]]:
        observed = self._knowledge.observed(self._group, self._scope, self.environment.roster)
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
            size = f"for {np.prod(shape):,} states and {len(self._strategy.choices)} goals"
            if self._counterstrategy is None:
                self.emit("strategy-made", f"made a strategy {size}", digest=self._strategy.digest)
            else:
                text = f"there is no strategy; the environment plays a counterstrategy {size}"
                self.emit("counterstrategy-made", text, level=Level.WARNING)
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
        self._show_environment()

    def _show_environment(self) -> None:
        """Record what each agent knows of the cells of others and of closed ones, where that changed."""
        shown = self._group.awareness[ENVIRONMENT.field(self.name)]
        tables = [
            self._cells.table(each.state) if each.state >= 0 else before
            for each, before in zip(self._memory, shown, strict=True)
        ]
        if not all(map(np.array_equal, tables, shown)):
            self.record(ENVIRONMENT, tables)

    def _decided(
        self, row: int, memory: StrategyMemory, position: Array, observed: tuple[int, ...], reports: list[_Report]
    ) -> StrategyMemory:
        """Return the memory of an agent after its turn."""
        observed = tuple(last if new < 0 else new for new, last in zip(observed, memory.values, strict=True))
        memory = memory._replace(values=observed)
        game, model = self._game, self._knowledge.model
        if memory.state < 0:
            cell = int(model.cells(position[None])[0])
        else:
            if not model.contains(memory.following, position):
                if not model.contains(int(game.values[CELL][memory.state]), position):
                    reports.append(_Report(row, "cells-left", "left its cells", Level.WARNING, {}))
                return memory
            cell = memory.following
        if self._counterstrategy is not None and (memory.state < 0 or self._counterstrategy.covers(memory.state)):
            if memory.stands:
                return memory
            played = self._played(row, self._counterstrategy, memory, cell, reports)
            if played is None:
                return memory._replace(state=max(memory.state, 0), following=cell, stands=True)
            observed, opposing = played
            memory = memory._replace(values=observed, opposing=opposing)
        if min(observed, default=0) < 0:
            return memory  # nothing can be decided until something is believed about everything
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
        texts = [each.text for each in self._game.assumptions for one in each.clauses if one.kind in LIVENESS]
        for text, late, known in zip(texts, overdue, memory.overdue, strict=True):
            if late and not known:
                said = f"`{text}` is overdue: nothing for {patience:g} s"
                reports.append(_Report(row, "assumption-overdue", said, Level.WARNING, {"assumption": text}))
            elif known and not late:
                reports.append(_Report(row, "assumption-kept", f"`{text}` was met", Level.INFO, {"assumption": text}))
        return memory._replace(met=met, overdue=overdue)

    def _played(
        self, row: int, counterstrategy: Counterstrategy, memory: StrategyMemory, cell: int, reports: list[_Report]
    ) -> tuple[tuple[int, ...], int] | None:
        """Return the values after a step of the counterstrategy, and the goal that the environment pursues then.

        Returns:
            None if the agent has broken a guarantee.
        """
        game, goal = self._game, memory.opposing
        if memory.state < 0:
            state, goal = counterstrategy.beginning(cell), 0
        else:
            state, goal = counterstrategy.answer(memory.state, goal, cell)
        if state is None:
            text = f"the environment has won: the guarantees cannot be kept in {game.vocabulary.cell.described(cell)}"
            reports.append(_Report(row, "guarantee-broken", text, Level.WARNING, {}))
            return None
        values = {name: int(each[state]) for name, each in game.values.items()}
        reports.append(_Report(row, "environment-moved", game.described(values), Level.INFO, {}))
        return tuple(values[each.name] for each in game.vocabulary.environment), goal


def _places(section: str, statements: Sequence[Statement], guilty: Sequence[Statement]) -> list[tuple[str, int]]:
    """Return the places of some statements in a section of the parameters."""
    return [(section, number) for number, each in enumerate(statements) if any(each is one for one in guilty)]
