"""From when a scenario says that agents are in the world to what a run needs to know of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.core import AgentGroup, Environment, nanoseconds
from symaware_cli.runtime.presence import Moment, PresenceInterval
from symaware_cli.runtime.scope import WORLD_NAMES, ConditionScope, further_parts
from symaware_cli.runtime.simulation import ComponentEntry
from symaware_cli.scenario.document import GroupSection, Presence
from symaware_cli.scenario.problem import quoted
from symaware_cli.scenario.section import TriggerSection
from symaware_cli.scenario.source import Path
from symaware_cli.scenario.timing_check import TimingCheck, trigger_of
from symaware_cli.specification.expression import EvaluationError, Expression


class PresenceBuilder:
    """Understands when agents enter and leave, and reports what is wrong with it."""

    def __init__(
        self,
        report: Callable[..., None],
        check: TimingCheck,
        environment: Environment,
        use: str,
        entries: Sequence[ComponentEntry],
    ) -> None:
        """Prepare.

        Args:
            report: Reports a problem: its code, a message, and the path of what it is about.
            check: Understands conditions and events.
            environment: The world.
            use: What the scenario calls it.
            entries: All components.
        """
        self._report = report
        self._check = check
        self._environment = environment
        self._use = use
        self._entries = entries
        self._world: Collection[str] = WORLD_NAMES

    def build(
        self, groups: Sequence[AgentGroup], agents: Mapping[str, GroupSection]
    ) -> Mapping[str, Sequence[PresenceInterval]]:
        """Tell of the groups that are not always there when each of their agents is.

        Those who are not there at the beginning are marked in their groups.
        """
        self._world = {*WORLD_NAMES, *further_parts(groups), *(groups[0].regions if groups else ())}
        spans = {}
        for group in groups:
            said = agents[group.name].present
            if said is not None:
                spans[group.name] = own = self._of(group, said)
                here = np.array([not each.is_late for each in own], bool)
                here.flags.writeable = False
                group.present = here
        return spans

    def _of(self, group: AgentGroup, said: Presence | list[Presence]) -> Sequence[PresenceInterval]:
        path: Path = ("agents", group.name, "present")
        if not self._environment.is_open:
            self._report("unsuitable", f"nobody enters or leaves the world {quoted(self._use)}", path, key=True)
        if isinstance(said, Presence):
            return [self._span(group, range(len(group)), said, path)] * len(group)
        if len(said) != len(group):
            values = "1 value" if len(said) == 1 else f"{len(said)} values"
            agents = "1 agent" if len(group) == 1 else f"{len(group)} agents"
            expected = f"one mapping for all, or a list of {len(group)}"
            self._report(
                "wrong-count", f"`{'.'.join(map(str, path))}` gives {values} for {agents}", path, expected=expected
            )
            return [PresenceInterval()] * len(group)
        return [self._span(group, [row], each, (*path, row)) for row, each in enumerate(said)]

    def _span(self, group: AgentGroup, rows: Sequence[int], said: Presence, path: Path) -> PresenceInterval:
        scope = ConditionScope(group)
        begin = self._moment(said.from_, group, self._world, (*path, "from"))
        end = self._moment(said.until, group, scope.names, (*path, "until"))
        if isinstance(end, int) and end <= (begin if isinstance(begin, int) else 0):
            self._report(
                "invalid-value",
                f"who leaves at {said.until:g} s has not entered by then",
                (*path, "until"),
                expected="a time after `from` [s]",
            )
        if isinstance(end, Expression):
            self._try(end, scope, rows[0], (*path, "until"))
        return PresenceInterval(begin, end)

    def _moment(
        self, said: float | str | TriggerSection | None, group: AgentGroup, names: Collection[str], path: Path
    ) -> Moment | None:
        """Understand a time, a condition or an event; None where nothing is said, or after a problem."""
        if isinstance(said, str):
            return self._check.expression(said, path, names)
        if not isinstance(said, TriggerSection):
            return None if said is None else nanoseconds(said)
        trigger = trigger_of(said.event, said.of)
        if path[-1] == "from" and trigger.source is None:
            whose = quoted(said.of) if said.of else "its own components"
            message = f"who is not there yet hears nothing of {whose}"
            expected = "`of` whom: `environment`, or the path of a component such as `agents.leader.steer`"
            self._report("unknown-source", message, (*path, "of") if said.of else path, expected=expected)
            return None
        self._check.source(trigger, group.name, self._entries, path)
        return trigger

    def _try(self, condition: Expression, scope: ConditionScope, row: int, path: Path) -> None:
        """See whether a condition has a value at the beginning, or lacks one for a reason that stays."""

        def look_up(name: str) -> Any:
            return 0.0 if name == "time" else scope.look_up(row, name)

        try:
            condition.holds(look_up)
        except EvaluationError as error:
            if isinstance(error.__cause__, IndexError | KeyError | TypeError):
                self._report("bad-expression", str(error), path, expected="a comparison such as `position[0] > 10`")
