"""Follows strategies: decides at each turn of an agent which cell it goes to, and what is reported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.components.assumption_monitor import AssumptionMonitor, BrokenAssumption
from symaware_cli.components.strategy_memory import Halt, Revision, StrategyMemory, StrategyTurn
from symaware_cli.components.strategy_revision import RevisedStrategy, RevisionParameters, StrategyRevisions
from symaware_cli.core import Level
from symaware_cli.synthesis.counterstrategy import Counterstrategy
from symaware_cli.synthesis.vocabulary import CELL
from symaware_cli.world.time import nanoseconds

#: What an agent does after the environment broke an assumption.
Fallback = Literal["stop", "resume", "last-safe-cell", "weaken"]
#: What an agent does when something that is assumed to happen again and again is overdue.
OverdueFallback = Literal["report", "stop", "resume", "last-safe-cell", "weaken"]


class StrategyFollower:
    """Advances what an agent remembers by a turn. It keeps nothing itself that a turn changes."""

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
            counterstrategy: What the environment plays; None for what is believed about it.
            monitor: Says which assumptions were broken.
            fallback: What is done then.
            overdue_fallback: What is done when something is overdue.
            revision: What it takes to make a strategy again.
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
        """The number of things that are assumed to happen again and again."""
        return self._monitor.goals

    def decided(self, memory: StrategyMemory, turn: StrategyTurn) -> StrategyMemory:
        """Return what an agent remembers after a turn; its memory already has the new values."""
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
        """Return the cell in which a step of the strategy is over, None if it is not, and the memory."""
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

    def _stepped(
        self, memory: StrategyMemory, after: Mapping[str, NDArray[np.intp]], turn: StrategyTurn
    ) -> StrategyMemory:
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
        """Return the memory after what is declared to be done about everything that is overdue."""
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
        """Return the memory without assumptions that were broken or are overdue, if all of them are written."""
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
        """Return why an agent stays where it is; empty if it goes on.

        Args:
            memory: What it remembers.
            broken: What the last step broke.
            covered: Whether there is a way to meet the guarantees by the strategy that it follows.
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
        after: Mapping[str, NDArray[np.intp]],
        turn: StrategyTurn,
    ) -> StrategyMemory:
        """Return the memory of an agent that goes back to the last cell from which the guarantees can be met.

        It stays where it is if there is such a way from there, if there is none from any cell of its path, or if it
        cannot go back without a risk to break a guarantee.
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

    def _state(self, memory: StrategyMemory, after: Mapping[str, NDArray[np.intp]]) -> int:
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
