"""A switch between two controllers: the simplex architecture.

Reasons: docs/decisions/0091-awareness-contracts.md
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import AgentGroup, GroupComponent, Parameters, Part, Quantity, ScenarioView, nanoseconds
from symaware_cli.engine import ConditionScope
from symaware_cli.specification import ExpressionError
from symaware_cli.specification.expression import Expression

#: Whether the fallback is in force: 1, or 0.
SWITCHED = Part("switched", columns=[Quantity("switched", "1")], description="1 while the fallback is in force")


class Switch(GroupComponent):
    """Decides at each turn which of two controllers of an agent is in force: the nominal one, or a fallback.

    It switches to the fallback when the condition ``when`` has held for ``confirm``, and back when the condition
    ``back`` has, but never before the present choice has been in force for its dwell time: so it switches a bounded
    number of times, whatever the conditions do. It is for groups of one agent, because conditions enable a group's
    controllers as a whole. The choice is the part of awareness ``switched``, 1 while the fallback
    is in force, by which both controllers are enabled: ``condition: switched[0] == 0`` and ``condition: switched[0] ==
    1``. Declare it before them. The nominal controller keeps its state while it is off.

    A condition on the status of a contract compares beliefs with the truth, which only a simulation knows: it shows
    what perfect monitoring would be worth. Conditions on ``uncertainty``, ``risk`` or ``nearest`` use beliefs alone.

    Source: L. Sha, "Using Simplicity to Control Complexity", IEEE Software 18(4), 2001.
    """

    parts: ClassVar[Sequence[Part]] = (SWITCHED,)
    events: ClassVar = {
        "switched": "The fallback of an agent came into force.",
        "switched-back": "The nominal controller of an agent came into force again.",
    }
    #: Parsed from the parameters.
    uncaptured: ClassVar[Sequence[str]] = ("_back", "_scope", "_when")

    class Parameters(Parameters):
        """When to switch, and how long to stay."""

        when: str = Field(
            max_length=500,
            description='The condition to switch to the fallback, such as `robustness["sees"] < 0.1` or '
            "`uncertainty > 0.5`.",
        )
        to: str = Field(max_length=64, description="The component that is the fallback, by its name.")
        back: str | None = Field(
            None,
            max_length=500,
            description="The condition to switch back; as soon as `when` does not hold if left out.",
        )
        confirm: float = Field(0.0, ge=0, le=1e9, description="How long a condition must hold to have an effect [s].")
        dwell: float = Field(0.0, ge=0, le=1e9, description="The least time that the fallback stays in force [s].")
        dwell_nominal: float = Field(
            0.0, ge=0, le=1e9, description="The least time that the nominal controller stays in force in between [s]."
        )

    @classmethod
    def check_scenario(cls, view: ScenarioView) -> None:
        """Refuse conditions that cannot be evaluated, and a fallback that is not enabled by the switch."""
        entry = view.entry
        if entry is None:
            return
        given = entry.components[0].parameters
        names = ConditionScope(entry.group).names([*view.specifications])
        for key in ("when", "back"):
            text = getattr(given, key)
            if text is None:
                continue
            try:
                Expression(text, names)
            except ExpressionError as error:
                known = f"one of {', '.join(error.names)}" if error.names else "a condition such as `uncertainty > 0.5`"
                view.report(f"`{text}`: {error.problem}", "with", key, key=False, expected=known)
        own = {each.name: each for each in view.own_entries}
        if len(entry.group) > 1:
            said = "controllers take their turns for whole groups, so a switch is for a group of one agent"
            view.report(said, "use", key=False, expected="a group of its own for each agent with a switch")
        if given.to not in own:
            view.report_unknown("component of these agents", given.to, "with", "to", known=own)
        elif SWITCHED.name not in getattr(own[given.to].timing.condition, "names", ()):
            said = f"`{given.to}` takes its turns whatever the switch decides"
            expected = f"`condition: {SWITCHED.name}[0] == 1` of `{given.to}`, and `== 0` of what it replaces"
            view.report(said, "with", "to", key=False, expected=expected)
        elif given.to not in {each.name for each in view.after}:
            view.report(f"`{given.to}` comes before the switch", "with", "to", key=False, expected="the switch first")

    def initialise_component(self, group: AgentGroup) -> None:
        """Start with the nominal controller."""
        super().initialise_component(group)
        given = self.parameters
        self._scope = ConditionScope(group)
        names = self._scope.names([*group.specifications])
        self._when = Expression(given.when, names)
        self._back = None if given.back is None else Expression(given.back, names)
        self._switched = np.zeros(len(group), bool)
        #: Since when the condition to change the choice of each agent has held, in nanoseconds; -1 if it does not.
        self._held = np.full(len(group), -1, np.int64)
        #: When each choice came into force, in nanoseconds. The first may be changed at once.
        self._since = np.full(len(group), -(10**18), np.int64)
        group.awareness[SWITCHED.name] = np.zeros((len(group), 1))

    def _compute(self) -> NDArray[np.bool_]:
        """Return for which agents the fallback is to be in force by the conditions, whatever the times are."""
        wanted = np.zeros(len(self._group), bool)
        for row in range(len(wanted)):  # conditions refer to values of one agent, as those of components do
            look_up = partial(self._scope.look_up, row)
            if self._back is not None and self._switched[row]:
                wanted[row] = not self._back.holds(look_up)
            else:
                wanted[row] = self._when.holds(look_up)
        return wanted

    def _update(self, wanted: NDArray[np.bool_]) -> None:
        given, now = self.parameters, self.now
        differs = wanted != self._switched
        self._held = np.where(differs, np.where(self._held < 0, now, self._held), -1)
        dwell = np.where(self._switched, nanoseconds(given.dwell), nanoseconds(given.dwell_nominal))
        changed = differs & (now - self._held >= nanoseconds(given.confirm)) & (now - self._since >= dwell)
        self._switched = self._switched ^ changed
        self._since, self._held = np.where(changed, now, self._since), np.where(changed, -1, self._held)
        self._group.awareness[SWITCHED.name] = self._switched[:, None].astype(float)
        for row in np.flatnonzero(changed).tolist():
            if self._switched[row]:
                self.emit_for(row, "switched", f"switched to `{given.to}`: `{given.when}` holds")
            else:
                self.emit_for(row, "switched-back", f"switched back from `{given.to}`")
