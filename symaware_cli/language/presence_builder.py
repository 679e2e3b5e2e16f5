"""Builds the presence of agents from a scenario: when each enters and leaves, with checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symaware_cli.core import AgentGroup, Environment, nanoseconds
from symaware_cli.engine import ComponentEntry, ConditionScope, Moment, PresenceInterval
from symaware_cli.language.document import GroupSection
from symaware_cli.language.presence_section import Presence, PresenceSpan
from symaware_cli.language.problem import quoted
from symaware_cli.language.section import TriggerSection
from symaware_cli.language.source import Path
from symaware_cli.language.timing_check import TimingCheck, trigger_of
from symaware_cli.specification import Names
from symaware_cli.specification.expression import EvaluationError, Expression
from symaware_cli.world import GroupChance, ProbabilityDistribution


class PresenceBuilder:
    """Builds the presence intervals of agents, and reports problems with them."""

    def __init__(
        self, check: TimingCheck, environment: Environment, use: str, entries: Sequence[ComponentEntry], seed: int
    ) -> None:
        """Prepare.

        Args:
            check: Parses conditions and checks events, and takes problems.
            environment: The environment.
            use: Its entry-point name.
            entries: All component entries.
            seed: The seed of the run.
        """
        self._report = check.diagnosis.report
        self._check = check
        self._environment = environment
        self._use = use
        self._entries = entries
        self._seed = seed
        self._world: Names = {}

    def build(
        self, groups: Sequence[AgentGroup], agents: Mapping[str, GroupSection]
    ) -> Mapping[str, Sequence[PresenceInterval]]:
        """Build the intervals of the agents of all groups that are not always present.

        Agents that are absent at the beginning are marked in their groups.
        """
        self._world = self._check.world_names(groups)
        intervals = {}
        for group in groups:
            given = agents[group.name].present
            if given is not None:
                intervals[group.name] = own = self._intervals(group, given)
                here = np.array([not each.is_late for each in own], bool)
                here.flags.writeable = False
                group.present = here
        return intervals

    def _intervals(self, group: AgentGroup, given: Presence | list[Presence]) -> Sequence[PresenceInterval]:
        path: Path = ("agents", group.name, "present")
        if not self._environment.is_open:
            message = f"the world {quoted(self._use)} does not support agents that enter or leave"
            self._report("unsuitable", message, path, key=True)
        if isinstance(given, Presence):
            return self._interval(group, range(len(group)), given, path)
        if len(given) != len(group):
            values = "1 value" if len(given) == 1 else f"{len(given)} values"
            agents = "1 agent" if len(group) == 1 else f"{len(group)} agents"
            expected = f"one mapping for all, or a list of {len(group)}"
            self._report(
                "wrong-count", f"`{'.'.join(map(str, path))}` gives {values} for {agents}", path, expected=expected
            )
            return [PresenceInterval()] * len(group)
        return [
            interval for row, each in enumerate(given) for interval in self._interval(group, [row], each, (*path, row))
        ]

    def _interval(self, group: AgentGroup, rows: Sequence[int], given: Presence, path: Path) -> list[PresenceInterval]:
        """Return the intervals of some agents of a group, from the entry for all of them."""
        self._check_order(given, path)
        spans = [self._span(group, rows, given, path, "scenario present")]
        for number, each in enumerate(given.again):
            spans.append(self._span(group, rows, each, (*path, "again", number), f"scenario present {number + 1}"))
        joined: list[PresenceInterval | None] = [None] * len(rows)
        for own in reversed(spans):
            joined = [replace(each, then=after) for each, after in zip(own, joined, strict=True)]
        return [each for each in joined if each is not None]

    def _check_order(self, given: Presence, path: Path) -> None:
        """Check that an agent leaves before it returns, and that the world lets it return."""
        if given.again and self._environment.is_open and not self._environment.can_return:
            message = f"the world {quoted(self._use)} does not support agents that return"
            self._report("unsuitable", message, (*path, "again"), key=True)
        before: PresenceSpan = given
        place = path
        for number, each in enumerate(given.again):
            here: Path = (*path, "again", number)
            if before.until is None:
                message = "an agent that returns has to leave before: `until` is missing"
                self._report("missing-field", message, place, expected="`until`: when it leaves")
            if each.from_ is None:
                self._report("missing-field", "`from` is missing: when it returns", here, expected="`from`")
            elif (
                isinstance(each.from_, int | float)
                and isinstance(before.until, int | float)
                and each.from_ <= before.until
            ):
                self._report(
                    "invalid-value",
                    f"an agent that leaves at {before.until:g} s cannot return at {each.from_:g} s",
                    (*here, "from"),
                    expected="a time after it has left [s]",
                )
            before, place = each, here

    def _span(
        self, group: AgentGroup, rows: Sequence[int], given: PresenceSpan, path: Path, draws: str
    ) -> list[PresenceInterval]:
        """Return one interval of some agents of a group."""
        scope = ConditionScope(group)
        begins = self._begins(given.from_, group, rows, (*path, "from"), draws)
        end = self._moment(given.until, group, scope.names(self._check.specifications), (*path, "until"))
        if isinstance(end, int) and any(end <= (begin if isinstance(begin, int) else 0) for begin in begins):
            self._report(
                "invalid-value",
                f"an agent that leaves at {given.until:g} s has not entered by then",
                (*path, "until"),
                expected="a time after `from` [s]",
            )
        if isinstance(end, Expression):
            self._check_condition(end, scope, rows[0], (*path, "until"))
        return [PresenceInterval(begin, end, given.apart) for begin in begins]

    def _begins(
        self,
        given: float | ProbabilityDistribution | str | TriggerSection | None,
        group: AgentGroup,
        rows: Sequence[int],
        path: Path,
        draws: str,
    ) -> list[Moment | None]:
        """Return when each of some agents enters; `draws` is the key of its random numbers."""
        if not isinstance(given, ProbabilityDistribution):
            return [self._moment(given, group, self._world, path)] * len(rows)
        # Drawn for all agents of the group, so that the time of one does not depend on who else has one.
        points = GroupChance(group.seeds or self._seed, draws, group.numbers).uniform(1)[:, 0]
        times = given.quantiles(points)
        return [nanoseconds(float(times[row])) for row in rows]

    def _moment(
        self, given: float | str | TriggerSection | None, group: AgentGroup, names: Names, path: Path
    ) -> Moment | None:
        """Convert a time, a condition or an event; None if nothing is given, or after a problem."""
        if isinstance(given, str):
            return self._check.expression(given, path, names)
        if not isinstance(given, TriggerSection):
            return None if given is None else nanoseconds(given)
        trigger = trigger_of(given.event, given.of)
        if path[-1] == "from" and trigger.source is None:
            whose = quoted(given.of) if given.of else "its own components"
            message = f"an agent that has not entered cannot wait for an event of {whose}"
            expected = "`of`: `environment`, or the path of a component such as `agents.leader.steer`"
            self._report("unknown-source", message, (*path, "of") if given.of else path, expected=expected)
            return None
        self._check.source(trigger, group.name, self._entries, path)
        return trigger

    def _check_condition(self, condition: Expression, scope: ConditionScope, row: int, path: Path) -> None:
        """Check that a condition can be evaluated at the beginning, unless the reason is temporary."""

        def look_up(name: str) -> Any:
            return 0.0 if name == "time" else scope.look_up(row, name)

        try:
            condition.holds(look_up)
        except EvaluationError as error:
            if isinstance(error.__cause__, IndexError | KeyError | TypeError):
                self._report("bad-expression", str(error), path, expected="a comparison such as `position[0] > 10`")
