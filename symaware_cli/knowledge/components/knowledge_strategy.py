"""Decides which cell to go to, by a strategy that is synthesised from knowledge about the environment."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from symaware_cli.awareness import BOX_COLUMNS
from symaware_cli.core import AgentGroup, Event, GroupComponent, Level, Quantity, ScenarioView, Signal
from symaware_cli.geometry import Indices
from symaware_cli.knowledge.components.cell_watch import CellWatch
from symaware_cli.knowledge.components.knowledge_check import (
    check_circular_assumptions,
    check_labels,
    warn_of_assumptions,
)
from symaware_cli.knowledge.components.knowledge_game import GameParameters, KnowledgeGame
from symaware_cli.knowledge.components.strategy_follower import (
    AssumptionMonitor,
    Fallback,
    OverdueFallback,
    StrategyFollower,
    StrategyMemory,
    StrategyTurn,
    TurnReport,
)
from symaware_cli.knowledge.components.strategy_revision import RevisionParameters, StrategyRevisions
from symaware_cli.knowledge.synthesis.best_effort import best_effort_strategy
from symaware_cli.knowledge.synthesis.conflict import conflict
from symaware_cli.knowledge.synthesis.counterstrategy import Counterstrategy, oppose
from symaware_cli.knowledge.synthesis.environment_cells import EnvironmentCells
from symaware_cli.knowledge.synthesis.game import Statement
from symaware_cli.knowledge.synthesis.strategy import Strategy, UnrealisableError, synthesise
from symaware_cli.knowledge.synthesis.strategy_codec import encoded
from symaware_cli.knowledge.synthesis.vocabulary import CELL, names_in_formula
from symaware_cli.specification import BeliefScope
from symaware_cli.world import ParameterError

PLAN = Signal(
    "plan",
    columns=(Quantity("cell", ""), Quantity("next_cell", ""), Quantity("goal", "")),
    description="the cell that the agent came to, the one that it goes to, and the number of the goal that it pursues",
    nan="the agent has not begun",
)
ENVIRONMENT = Signal(
    "environment",
    "table",
    [*(Quantity(each, "m") for each in BOX_COLUMNS), Quantity("crossed", "1")],
    drawn="boxes",
    description="cells of others as believed or played; and, crossed, those that the environment closes to the agent",
)


class KnowledgeStrategy(GroupComponent):
    """Chooses the next cell by a strategy that meets all guarantees while the environment keeps the assumptions.

    The strategy is synthesised before the run, from formulas in the fragment GR(1) about the cells of a knowledge
    model, and checked by a model checker. It takes a step at the turns at which the agent believes to have reached the
    chosen cell; the state of the environment is then as the agent believes it. If the environment breaks an assumption,
    the agent stops in its cell by default. An event reports an agent that leaves its present and next cell, or skips
    the next one; another component steers it.

    When the agent learns of cells that cannot be entered, the strategy is made again without them.
    """

    signals = (PLAN, ENVIRONMENT)
    events: ClassVar = {
        "strategy-made": "A strategy was made before the run; `digest` identifies it.",
        "counterstrategy-made": "There is no strategy; the environment plays a counterstrategy.",
        "environment-moved": "The environment took a step of its counterstrategy.",
        "beliefs-missing": "An agent does not begin, as it believes nothing about `labels` yet.",
        "guarantee-broken": "The environment has won: the agent had no choice that keeps its guarantees.",
        "goal-met": "An agent came to meet the goal that it pursued; `number` counts goals from 0.",
        "assumption-broken": "The environment did what the assumptions exclude; `assumptions` lists those it broke.",
        "assumption-overdue": "What is assumed to happen again and again did not happen within the patience.",
        "assumption-kept": "What was overdue happened.",
        "assumption-dropped": "A strategy is made again without the assumptions that the environment broke.",
        "cells-learnt": "The agent learnt which cells cannot be entered; `cells` lists them all.",
        "turned-back": "The cell that the agent was going to cannot be entered, so it goes back.",
        "strategy-revised": "A strategy that was made again takes effect; `digest` identifies it, `effort` counts the"
        " states that were looked at.",
        "budget-exceeded": "To make a strategy again would take more than the budget.",
        "strategy-unrealisable": "No strategy from what the agent has learnt meets its guarantees from where it is.",
        "retreated": "The agent goes back towards the last cell from which its guarantees can be met.",
        "strategy-resumed": "An agent that had stopped goes on.",
        **CellWatch.EVENTS,
    }
    # Made from the parameters and the model before the run, and the same in each run of the scenario.
    uncaptured: ClassVar[Collection[str]] = (
        "_knowledge",
        "_game",
        "_strategy",
        "_counterstrategy",
        "_cells",
        "_follower",
    )

    class Parameters(GameParameters):
        """Knowledge about the environment, the goals, and the fallback."""

        on_unrealisable: Literal["refuse", "counterstrategy"] = Field(
            "refuse",
            description="What to do if there is no strategy: refuse the scenario, with the reason; or run it with an"
            " environment that plays a counterstrategy instead of what is believed, to watch how it wins.",
        )
        on_violation: Fallback = Field(
            "stop",
            description="What an agent does after the environment broke an assumption: it stays in its cell; it goes"
            " on as soon as there is a way to meet the guarantees from where it is; it goes back to the last cell from"
            " which there is one; or it goes on by a strategy without the broken assumption, if there is one.",
        )
        blocked: str | None = Field(
            None,
            min_length=1,
            description="The name of the knowledge that lists cells, by their names, that cannot be entered. When it"
            " changes, the strategy is made again.",
        )
        knowledge: dict[str, str] = Field(
            default_factory=dict,
            description="What the agent is to know of its own state, by the name in its knowledge: a label of its cell,"
            " such as `loaded` of a gripper. It is 1 while the cell that it came to has the label, and 0 otherwise.",
        )
        revision: RevisionParameters = Field(
            default_factory=RevisionParameters, description="What it takes to make a strategy again during the run."
        )
        patience: float | None = Field(
            None,
            gt=0,
            description="Time after which something that is assumed to happen again and again is reported as overdue"
            " [s]. By default it is not.",
        )
        on_overdue: OverdueFallback = Field(
            "report",
            description="What an agent does when something is overdue: it reports that, and goes on to wait; it stays"
            " in its cell for good; it stays until that happens after all; it goes back to the last cell from which"
            " there is a way to meet the guarantees without that assumption, and stays there; or it goes on by a"
            " strategy without it, if there is one.",
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
        unknown, count = (-1,) * len(self._game.vocabulary.environment), self._follower.awaited
        start = StrategyMemory(unknown, (self.now,) * count, (False,) * count)
        self._memory = [start] * len(group)
        self._is_announced = False
        self._waiting: tuple[int, ...] = ()  # the rows of the agents whose missing beliefs were reported
        self._watch = CellWatch(self._knowledge.model, len(group))
        self._surroundings.events.subscribe("stepped", self._on_stepped, "environment")

    # Before the run

    def attachments(self) -> Mapping[str, bytes]:
        """Return the strategy."""
        return {"strategy": encoded(self._strategy)}

    def check_scenario(self, view: ScenarioView) -> None:
        """Check the agents and conditions of labels, and that no groups wait for each other for ever."""
        if hasattr(self, "_knowledge"):
            check_labels(self._knowledge, view)
            strategies = [
                (each.group.name, component._knowledge.awaited)
                for each in view.entries
                if isinstance(component := each.components[0], KnowledgeStrategy) and hasattr(component, "_knowledge")
            ]
            check_circular_assumptions(view, self._knowledge.awaited, strategies)

    def find_warnings(self, view: ScenarioView) -> None:
        """Look for assumptions that no environment can keep."""
        warn_of_assumptions(self._knowledge, view)

    def _prepare(self, group: AgentGroup) -> None:
        """Make the game and the strategy.

        Raises:
            ParameterError: A parameter is invalid.
        """
        given = self.parameters
        self._knowledge = KnowledgeGame(given, group)
        self._game = game = self._knowledge.game
        self._cells = EnvironmentCells(game, self._knowledge.model)
        self._check_knowledge(group)
        self._check_revision(group)
        self._counterstrategy: Counterstrategy | None = None
        try:
            self._strategy: Strategy = synthesise(game, self._knowledge.starts)
        except UnrealisableError as error:
            if self.parameters.on_unrealisable == "refuse" or not game.starts(self._knowledge.starts)[1].any():
                raise self._unrealisable(error) from None
            self._counterstrategy, self._strategy = oppose(game), best_effort_strategy(game)
        revisions = StrategyRevisions(self._strategy, given.revision)
        monitor = AssumptionMonitor(game, given.patience)
        self._follower = StrategyFollower(
            self._knowledge.model,
            revisions,
            self._counterstrategy,
            monitor,
            given.on_violation,
            given.on_overdue,
            given.revision,
        )

    def _check_knowledge(self, group: AgentGroup) -> None:
        """Check the knowledge of agents that follows the labels of their cells.

        Raises:
            ParameterError: There is no such label, or an agent has no initial value for it.
        """
        labels = self._knowledge.model.system.labels
        for name, label in self.parameters.knowledge.items():
            if label not in labels:
                known = ", ".join(sorted(labels)) or "none"
                raise ParameterError(f"no cell has the label `{label}`; there are: {known}", ("knowledge", name))
            for id, known_at_first in zip(group.ids, group.knowledge, strict=True):
                if known_at_first.get(name) not in (0, 1):
                    said = f"{id} does not know `{name}`; declare what holds at first: `knowledge: {{{name}: 0}}`"
                    raise ParameterError(said, ("knowledge", name))

    def _check_revision(self, group: AgentGroup) -> None:
        """Check the parameters of strategies that are made again.

        Raises:
            ParameterError: One is invalid.
        """
        given = self.parameters
        weakens = [name for name in ("on_violation", "on_overdue") if getattr(given, name) == "weaken"]
        is_revised = given.blocked is not None or bool(weakens)
        if given.on_overdue != "report" and given.patience is None:
            raise ParameterError("nothing is ever overdue without a `patience` [s]", ("on_overdue",))
        if given.on_unrealisable == "counterstrategy" and is_revised:
            said = "an environment that plays a counterstrategy needs the strategy as it was made before the run"
            without = f"`{weakens[0]}: weaken`" if weakens else "`blocked`"
            raise ParameterError(f"{said}: leave {without} out", ("on_unrealisable",))
        if "revision" in given.model_fields_set and not is_revised:
            said = "no strategy is made again without `blocked`, or `weaken` for `on_violation` or `on_overdue`"
            raise ParameterError(said, ("revision",))
        if given.revision.run_in == "process" and not given.revision.latency:
            said = "a strategy that is due at once is waited for at once: a process of its own needs a `latency` [s]"
            raise ParameterError(said, ("revision", "run_in"))
        for row, known in enumerate(group.knowledge if given.blocked is not None else ()):
            if given.blocked not in known:
                said = (
                    f"{group.ids[row]} does not know `{given.blocked}`; declare it, with the cells that are blocked at"
                )
                raise ParameterError(f"{said} first: `knowledge: {{{given.blocked}: {{all: []}}}}`", ("blocked",))
            try:
                self._blocked(known, group.ids[row])
            except ValueError as error:
                raise ParameterError(str(error), ("blocked",)) from None

    def _unrealisable(self, error: UnrealisableError) -> ParameterError:
        """Explain why there is no strategy, at each of the formulas in conflict."""
        guilty = conflict(self._game, self._knowledge.starts)
        if not self._game.starts(self._knowledge.starts)[1].any():
            return ParameterError(f"there is no strategy: {error}", ("assumptions",))
        if not guilty.guarantees:
            said = "whatever the guarantees, the agent comes to a cell that it can neither stay in nor leave"
            return ParameterError(f"there is no strategy: {said}, for example from: {error}", ("model",))
        *others, last = [
            *_places("assumptions", self._game.assumptions, (*guilty.helpful, *guilty.opposing)),
            *_places("guarantees", self._game.guarantees, guilty.guarantees),
        ]
        nowhere = _labels_of_no_cell(guilty.guarantees, self._knowledge.model.system.labels)
        return ParameterError(
            f"there is no strategy: whatever the agent does, the environment can keep all assumptions and prevent it. "
            f"{guilty}, for example from: {error}{nowhere}. With `on_unrealisable: counterstrategy` the environment "
            f"shows in a run how",
            last,
            related=[(place, "this is a part of the conflict") for place in others],
        )

    # During the run

    def _compute(self) -> tuple[list[StrategyMemory], list[TurnReport]]:
        group = self._group
        observed = self._knowledge.observed(group, self._scope, self.environment.roster)
        positions = group.model.positions(group.awareness.state)
        reports: list[TurnReport] = []
        memories = []
        for row, memory in enumerate(self._memory):
            values = tuple(int(column[row]) for column in observed)
            values = tuple(last if new < 0 else new for new, last in zip(values, memory.values, strict=True))
            blocked = self._blocked(group.knowledge[row], group.ids[row])
            turn = StrategyTurn(row, self.now, blocked, positions[row], reports)
            if min(values, default=0) < 0 and row not in self._waiting:
                self._report_missing(values, turn)
            memories.append(self._follower.decided(memory._replace(values=values), turn))
        return memories, reports

    def _report_missing(self, values: Sequence[int], turn: StrategyTurn) -> None:
        """Report the labels that an agent must have beliefs about before it can begin."""
        variables = self._game.vocabulary.environment
        labels = [each.name for each, value in zip(variables, values, strict=True) if value < 0]
        said = ", ".join(f"`{each}`" for each in labels)
        turn.report("beliefs-missing", f"does not begin: it believes nothing about {said} yet", labels=labels)

    def _update(self, value: tuple[list[StrategyMemory], list[TurnReport]]) -> None:
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
        missing = [each.row for each in reports if each.name == "beliefs-missing"]
        self._waiting = (*self._waiting, *missing)
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
        self._tell_state(cells)
        self._show_environment()

    def _tell_state(self, cells: Indices) -> None:
        """Update the knowledge of each agent about the labels of its present cell."""
        labels = self._knowledge.model.system.labels
        for name, label in self.parameters.knowledge.items():
            for known, memory in zip(self._group.knowledge, self._memory, strict=True):
                has = int(memory.state >= 0 and int(cells[memory.state]) in labels[label])
                if memory.state >= 0 and known[name] != has:
                    known[name] = has

    def _on_stepped(self, event: Event) -> None:
        """Watch the believed positions of agents after each step of the world, not only at turns."""
        group, cells = self._group, self._game.values[CELL]
        positions = group.model.positions(group.awareness.state)
        for row in group.rows.tolist():
            memory = self._memory[row]
            if memory.state < 0:
                continue
            found = self._watch.seen(row, int(cells[memory.state]), memory.following, positions[row])
            if found is not None:
                self.emit_for(row, found.name, found.text, level=found.level, **found.data)

    def _show_environment(self) -> None:
        """Record the cells of others and the closed cells, as each agent knows them, if they changed."""
        shown = self._group.awareness[ENVIRONMENT.field(self.name)]
        tables = [
            self._cells.table(each.state) if each.state >= 0 else before
            for each, before in zip(self._memory, shown, strict=True)
        ]
        if not all(map(np.array_equal, tables, shown)):
            self.record(ENVIRONMENT, tables)

    def _blocked(self, known: Mapping[str, object], agent: str) -> tuple[int, ...]:
        """Return the cells that an agent knows to be blocked, ascending.

        Raises:
            ValueError: The knowledge is not a list of cells of the model.
        """
        name = self.parameters.blocked
        if name is None:
            return ()
        states, cells = self._knowledge.model.system.states, known[name]
        if isinstance(cells, str) or not isinstance(cells, Sequence):
            raise ValueError(f"the knowledge `{name}` of {agent} is {cells!r}, and no list of cells")
        for each in cells:
            if each not in states:
                model = self.parameters.model
                raise ValueError(f"the knowledge `{name}` of {agent} lists {each!r}, which is no cell of `{model}`")
        return tuple(sorted({states.index(each) for each in cells}))


def _labels_of_no_cell(statements: Sequence[Statement], labels: Mapping[str, Collection[int]]) -> str:
    """Return a remark about the labels in some statements that no cell has; empty if there are none."""
    nodes = (node for each in statements for one in each.clauses for node in (one.node, one.answer) if node)
    found = sorted({name for node in nodes for name in names_in_formula(node) if name in labels and not labels[name]})
    return f"; no cell has the label {' or '.join(f'`{name}`' for name in found)}" if found else ""


def _places(section: str, statements: Sequence[Statement], guilty: Sequence[Statement]) -> list[tuple[str, int]]:
    """Return the places of some statements in a section of the parameters."""
    return [(section, number) for number, each in enumerate(statements) if any(each is one for one in guilty)]
