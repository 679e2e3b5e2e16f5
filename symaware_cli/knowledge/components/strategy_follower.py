"""Follows strategies: decides at each turn of an agent on its next cell and on the events to report.

An agent that follows a strategy has a memory, and monitors whether its environment keeps the assumptions.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from symaware_cli.core import Level
from symaware_cli.geometry import Array, Indices
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.knowledge.components.strategy_revision import (
    RevisedStrategy,
    Revision,
    RevisionParameters,
    StrategyRevisions,
)
from symaware_cli.knowledge.synthesis.counterstrategy import Counterstrategy
from symaware_cli.knowledge.synthesis.fragment import LIVENESS
from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.vocabulary import CELL
from symaware_cli.world import SECOND, nanoseconds

#: The reason why an agent stays in its cell: an assumption was broken or is overdue, a strategy is being made, or there
#: is no strategy from its state.
Halt = Literal["", "violation", "overdue", "revision", "unrealisable"]


class StrategyMemory(NamedTuple):
    """The memory of an agent from turn to turn. States are those of the game with all assumptions and all cells.

    Attributes:
        values: The last known values of the environment's variables, in their order; -1 for none.
        met: The instant at which each goal of the environment was last met [ns].
        overdue: Whether each of these goals was reported to be overdue.
        state: The state at the last decision; -1 before the first one.
        goal: The goal that it pursues.
        following: The cell that it decided to go to.
        halt: The reason why it follows no strategy; empty if it does.
        opposing: The goal that the environment pursues, if it plays a counterstrategy.
        path: The cells through which it came, without loops; the present one is the last.
        dropped: The numbers of the assumptions that it has given up, ascending.
        distrusted: The numbers of the overdue assumptions because of which it stays, ascending.
        revision: The revision whose strategy it follows.
        pending: The revision for which a strategy is being made; None for none.
        due: The instant at which that strategy takes effect [ns].
    """

    values: tuple[int, ...]
    met: tuple[int, ...]
    overdue: tuple[bool, ...]
    state: int = -1
    goal: int = 0
    following: int = -1
    halt: Halt = ""
    opposing: int = 0
    path: tuple[int, ...] = ()
    dropped: tuple[int, ...] = ()
    distrusted: tuple[int, ...] = ()
    revision: Revision = Revision()
    pending: Revision | None = None
    due: int = 0

    def walked(self, cell: int) -> tuple[int, ...]:
        """Return the path with a further cell; a cell that is in the path already cuts it there."""
        if cell in self.path:
            return self.path[: self.path.index(cell) + 1]
        return (*self.path, cell)


class TurnReport(NamedTuple):
    """An event of a turn.

    Attributes:
        row: The row of the agent.
        name: The name of the event.
        text: One line for people.
        level: Its importance.
        data: Further facts.
    """

    row: int
    name: str
    text: str
    level: Level
    data: Mapping[str, Any]


@dataclass(frozen=True)
class StrategyTurn:
    """A turn of an agent.

    Attributes:
        row: The row of the agent.
        now: The instant [ns].
        blocked: The cells that it knows to be blocked, ascending.
        position: Its believed position [m]; shape (d,).
        reports: The events so far of the turns of its group at this instant.
    """

    row: int
    now: int
    blocked: tuple[int, ...]
    position: Array
    reports: list[TurnReport]

    def report(self, name: str, text: str, level: Level = Level.INFO, **data: object) -> None:
        """Add an event to the reports."""
        self.reports.append(TurnReport(self.row, name, text, level, data))


class BrokenAssumption(NamedTuple):
    """An assumption that a step of the environment broke, or that is overdue.

    Attributes:
        text: The assumption.
        number: Its number; None for the implicit assumption that another agent moves from cell to cell.
    """

    text: str
    number: int | None


class AssumptionMonitor:
    """Compares the steps of an environment with the assumptions of a game."""

    def __init__(self, game: Game, patience: float | None) -> None:
        """Prepare.

        Args:
            game: The game.
            patience: Time after which a goal of the environment that was not met again is overdue [s]; None for never.
        """
        self._game = game
        self._patience = patience
        self._goals = game.goals(game.assumptions)
        numbered = enumerate(game.assumptions)
        self._numbers = [number for number, each in numbered for one in each.clauses if one.kind in LIVENESS]

    @property
    def goals(self) -> int:
        """The number of goals of the environment: the conditions that are assumed to hold again and again."""
        return len(self._goals)

    def broken(self, state: int, after: Mapping[str, Indices], dropped: Collection[int]) -> list[BrokenAssumption]:
        """Return the assumptions that a step broke.

        Args:
            state: The state before the step; -1 at the beginning.
            after: The value of each variable after it; shape (1,) each.
            dropped: The numbers of assumptions to ignore.
        """
        game = self._game
        numbered = [(number, each) for number, each in enumerate(game.assumptions) if number not in dropped]
        if state < 0:
            wrong = [(number, each) for number, each in numbered if not game.holds_at_start([each], after)[0]]
            return [BrokenAssumption(each.text, number) for number, each in wrong]
        now = {name: each[[state]] for name, each in game.values.items()}
        broken = [
            BrokenAssumption(f"{variable.name} moves from cell to cell", None)
            for variable in game.vocabulary.environment
            if after[variable.name][0] not in variable.following[now[variable.name][0]]
        ]
        for number, each in numbered:
            safety = game.safety([each])
            if not all(np.all(holds(now, after) if ahead else holds(after, None)) for holds, ahead in safety):
                broken.append(BrokenAssumption(each.text, number))
        return broken

    def overdue(self, memory: StrategyMemory) -> list[BrokenAssumption]:
        """Return the overdue assumptions in their order, without those that were given up."""
        late = {number for number, is_late in zip(self._numbers, memory.overdue, strict=True) if is_late}
        return [
            BrokenAssumption(self._game.assumptions[number].text, number) for number in sorted(late - {*memory.dropped})
        ]

    def reminded(self, memory: StrategyMemory, state: int, turn: StrategyTurn) -> StrategyMemory:
        """Note which goals the environment meets in a state; report those newly overdue, and overdue ones now met."""
        met = tuple(turn.now if goal[state] else last for goal, last in zip(self._goals, memory.met, strict=True))
        if self._patience is None:
            return memory._replace(met=met)
        late = tuple(turn.now - last > self._patience * SECOND for last in met)
        for number, is_late, was_late in zip(self._numbers, late, memory.overdue, strict=True):
            text = self._game.assumptions[number].text
            if number in memory.dropped or is_late == was_late:
                continue
            if is_late:
                said = f"`{text}` is overdue: nothing for {self._patience:g} s"
                turn.report("assumption-overdue", said, Level.WARNING, assumption=text)
            else:
                turn.report("assumption-kept", f"`{text}` was met", assumption=text)
        return memory._replace(met=met, overdue=late)


#: The reaction of an agent to a broken assumption.
Fallback = Literal["stop", "resume", "last-safe-cell", "weaken"]
#: The reaction of an agent to an overdue assumption.
OverdueFallback = Literal["report", "stop", "resume", "last-safe-cell", "weaken"]


class StrategyFollower:
    """Advances the memory of an agent by a turn. A turn does not change the follower itself."""

    def __init__(
        self,
        model: KnowledgeModel,
        revisions: StrategyRevisions,
        counterstrategy: Counterstrategy | None,
        monitor: AssumptionMonitor,
        fallback: Fallback,
        overdue_fallback: OverdueFallback,
        revision: RevisionParameters,
    ) -> None:
        """Prepare.

        Args:
            model: The cells.
            revisions: The strategies.
            counterstrategy: The counterstrategy that the environment plays; None to use the agents' beliefs about it.
            monitor: Finds broken and overdue assumptions.
            fallback: The reaction to a broken assumption.
            overdue_fallback: The reaction to an overdue assumption.
            revision: The latency and the budget of making a strategy again.
        """
        self._game = revisions.game
        self._model = model
        self._revisions = revisions
        self._counterstrategy = counterstrategy
        self._monitor = monitor
        self._fallback = fallback
        self._overdue_fallback = overdue_fallback
        self._revision = revision

    @property
    def awaited(self) -> int:
        """The number of goals of the environment."""
        return self._monitor.goals

    def decided(self, memory: StrategyMemory, turn: StrategyTurn) -> StrategyMemory:
        """Return the memory of an agent after a turn; the given memory already has the new values."""
        game = self._game
        memory = self._revised(memory, turn)
        cell, memory = self._arrived(memory, turn)
        if cell is None:
            return memory
        if self._counterstrategy is not None and (memory.state < 0 or self._counterstrategy.covers(memory.state)):
            if memory.halt:
                return memory
            played = self._played(self._counterstrategy, memory, cell, turn)
            if played is None:
                return memory._replace(state=max(memory.state, 0), following=cell, halt="violation")
            memory = memory._replace(values=played[0], opposing=played[1])
        if min(memory.values, default=0) < 0:
            return memory  # nothing can be decided until something is believed about everything
        names = [each.name for each in game.vocabulary.environment]
        after = {name: np.array([value]) for name, value in zip(names, memory.values, strict=True)}
        after[CELL] = np.array([cell])
        return self._stepped(memory, after, turn)

    def _arrived(self, memory: StrategyMemory, turn: StrategyTurn) -> tuple[int | None, StrategyMemory]:
        """Return the cell in which a step of the strategy ended, None while it goes on, and the memory."""
        model = self._model
        if memory.state < 0:
            return int(model.cells(turn.position[None])[0]), memory
        here = int(self._game.values[CELL][memory.state])
        if memory.following in turn.blocked and memory.following != here and model.contains(here, turn.position):
            turn.report(
                "turned-back", f"{self._named(memory.following)} cannot be entered: stays in {self._named(here)}"
            )
            memory = memory._replace(following=here)
        return (memory.following if model.contains(memory.following, turn.position) else None), memory

    def _stepped(self, memory: StrategyMemory, after: Mapping[str, Indices], turn: StrategyTurn) -> StrategyMemory:
        """Return the memory after a step of the game to some values."""
        cell = int(after[CELL][0])
        broken = self._monitor.broken(memory.state, after, memory.dropped)
        before, state = memory.state, self._state(memory, after)
        memory = self._monitor.reminded(memory, state, turn)
        if broken:
            texts = [each.text for each in broken]
            said = f"the environment broke {_listed(texts)}"
            turn.report("assumption-broken", said, Level.WARNING, assumptions=texts)
            if self._fallback == "weaken":
                memory = self._revised(self._weakened(memory, broken, turn), turn)
        memory = self._warned(memory, turn)
        strategy = self._revisions.strategy(memory.revision)
        halt = self._halt(memory, broken, strategy.covers(state))
        if memory.halt and not halt:
            turn.report("strategy-resumed", "goes on")
        if halt == "unrealisable" != memory.halt:
            turn.report("strategy-unrealisable", f"there is no strategy from {self._named(cell)}", Level.WARNING)
        reached = memory._replace(state=state, following=cell, halt=halt, path=memory.walked(cell))
        if halt:
            fallback = self._overdue_fallback if halt == "overdue" else self._fallback
            if fallback != "last-safe-cell" or halt == "revision":
                return reached
            dropped = tuple(sorted({*memory.dropped, *memory.distrusted}))
            safe = self._revisions.strategy(memory.revision._replace(dropped=dropped))
            return self._retreated(reached, memory, safe, after, turn)
        following, goal = strategy.choice(state, memory.goal)
        number = memory.goal
        if strategy.reaches(state, number) and not (before >= 0 and strategy.reaches(before, number)):
            turn.report("goal-met", f"met goal {number}", number=number)
        if following in turn.blocked:
            return reached  # the strategy is older than what the agent knows: it waits for the next one
        return reached._replace(goal=goal, following=following)

    def _revised(self, memory: StrategyMemory, turn: StrategyTurn) -> StrategyMemory:
        """Return the memory after an agent has begun to make a new strategy, or has made one."""
        wanted = Revision(turn.blocked, memory.dropped)
        if memory.pending is None and wanted != memory.revision:
            if wanted.blocked != memory.revision.blocked:
                cells = [self._named(each) for each in turn.blocked]
                said = f"{', '.join(cells)} cannot be entered" if cells else "no cell is blocked"
                turn.report("cells-learnt", f"learnt that {said}", cells=cells)
            self._revisions.begin(wanted)
            memory = memory._replace(pending=wanted, due=turn.now + nanoseconds(self._revision.latency))
        if memory.pending is None or turn.now < memory.due:
            return memory
        made = self._revisions.strategy(memory.pending).strategy
        if made is None:
            said = f"more than {self._revision.budget:,} states would have to be looked at to make a strategy"
            turn.report("budget-exceeded", said, Level.WARNING)
        else:
            said = f"follows a strategy that was made again, for which {made.effort:,} states were looked at"
            turn.report("strategy-revised", said, digest=made.digest, effort=made.effort)
        return memory._replace(revision=memory.pending, pending=None)

    def _warned(self, memory: StrategyMemory, turn: StrategyTurn) -> StrategyMemory:
        """Return the memory after the declared reaction to overdue assumptions."""
        if self._overdue_fallback == "report":
            return memory
        overdue = self._monitor.overdue(memory)
        if self._overdue_fallback == "weaken":
            return self._revised(self._weakened(memory, overdue, turn), turn) if overdue else memory
        lasting = () if self._overdue_fallback == "resume" else memory.distrusted
        numbers = [each.number for each in overdue if each.number is not None]
        return memory._replace(distrusted=tuple(sorted({*lasting, *numbers})))

    def _weakened(
        self, memory: StrategyMemory, broken: Sequence[BrokenAssumption], turn: StrategyTurn
    ) -> StrategyMemory:
        """Return the memory without assumptions that were broken or are overdue, unless one of them is implicit."""
        numbers = [each.number for each in broken if each.number is not None]
        if len(numbers) < len(broken):
            return memory
        texts = [each.text for each in broken]
        turn.report("assumption-dropped", f"no longer assumes {_listed(texts)}", Level.WARNING, assumptions=texts)
        return memory._replace(dropped=tuple(sorted({*memory.dropped, *numbers})))

    def _halt(
        self,
        memory: StrategyMemory,
        broken: Sequence[BrokenAssumption],
        covered: bool,
    ) -> Halt:
        """Return the reason why an agent stays in its cell; empty if it goes on.

        Args:
            memory: Its memory.
            broken: The assumptions that the last step broke.
            covered: Whether the strategy that it follows can meet the guarantees from its state.
        """
        is_weakened = all(each.number in memory.dropped for each in broken)
        if not is_weakened or memory.halt == "violation":
            return "" if self._fallback == "resume" and covered else "violation"
        if memory.distrusted:
            return "overdue"
        if memory.pending is not None and (broken or memory.halt or not covered):
            return "revision"
        return "" if covered else "unrealisable"

    def _retreated(
        self,
        reached: StrategyMemory,
        memory: StrategyMemory,
        strategy: RevisedStrategy,
        after: Mapping[str, Indices],
        turn: StrategyTurn,
    ) -> StrategyMemory:
        """Return the memory of an agent that goes back to the last cell from which the guarantees can be met.

        It stays if they can be met from its present cell, if they cannot be met from any cell of its path, or if going
        back might break a guarantee.
        """
        states = [self._state(memory, {**after, CELL: np.array([each])}) for each in reached.path]
        if strategy.covers(reached.state) or not any(strategy.covers(each) for each in states):
            return reached
        game, cell, back = self._game, reached.path[-1], reached.path[-2]
        following = game.vocabulary.cell.following[cell]
        if back in turn.blocked or back not in following:
            return reached
        if (game.moves[following.index(back), :, reached.state] == game.size + 1).any():
            return reached
        turn.report("retreated", f"goes back to {self._named(back)}")
        return reached._replace(following=back)

    def _named(self, cell: int) -> str:
        return self._model.system.states[cell]

    def _state(self, memory: StrategyMemory, after: Mapping[str, Indices]) -> int:
        game = self._game
        if memory.state < 0:
            return int(game.starting(after)[0])
        bits = [bit.updated(each[[memory.state]], after) for bit, each in zip(game.bits, game.bit_values, strict=True)]
        return int(game.index(after, bits)[0])

    def _played(
        self, counterstrategy: Counterstrategy, memory: StrategyMemory, cell: int, turn: StrategyTurn
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
            turn.report("guarantee-broken", text, Level.WARNING)
            return None
        values = {name: int(each[state]) for name, each in game.values.items()}
        turn.report("environment-moved", game.described(values))
        return tuple(values[each.name] for each in game.vocabulary.environment), goal


def _listed(texts: Sequence[str]) -> str:
    return " and ".join(f"`{each}`" for each in texts)
