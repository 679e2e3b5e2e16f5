"""Checks of strategies in a whole scenario: agents that labels are about, values, and assumptions.

If agents assume only safety of each other, all of them are safe, by induction over the steps (Abadi and Lamport,
Conjoining specifications, ACM TOPLAS 17(3), 1995). For liveness this fails: each may wait for ever for the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from symaware_cli.core import ScenarioView
from symaware_cli.knowledge.components.knowledge_game import KnowledgeGame


def check_labels(game: KnowledgeGame, view: ScenarioView) -> None:
    """Report labels about agents that do not exist, or whose conditions have no value at the beginning."""
    assert view.entry is not None
    if len(view.groups) == len(view.document.agents):
        known = sorted(id for group in view.groups for id in group.ids)
        for (label, key), agent in game.named_agents.items():
            if agent not in known:
                view.report_unknown("agent", agent, "with", "labels", label, key, known=known)
    for label, said in game.undefined(view.entry.group, view.environment) if view.is_initialised else ():
        message = f"the label `{label}` has no value: {said}"
        view.report(message, "with", "labels", label, key=False, code="bad-expression")


def check_circular_assumptions(
    view: ScenarioView, own: Mapping[int, set[str]], every: Iterable[tuple[str, Mapping[int, set[str]]]]
) -> None:
    """Report each liveness assumption that closes a circle, in which groups may wait for each other for ever.

    Args:
        view: The scenario.
        own: The agents that liveness assumptions of this strategy are about, by the number of the assumption.
        every: The same for each strategy of the scenario, with the name of its group.
    """
    assert view.entry is not None
    name = view.entry.group.name
    group_of = {agent: group.name for group in view.groups for agent in group.ids}
    after: dict[str, set[str]] = {}
    for group, assumed in every:
        after.setdefault(group, set()).update(*(_groups(agents, group_of) for agents in assumed.values()))
    for number, agents in own.items():
        circle = next((each for each in sorted(_groups(agents, group_of)) if name in _reachable(each, after)), None)
        if circle is not None:
            view.report(
                f"`{name}` waits for `{circle}`, and that waits for `{name}`: they might wait for each other for ever",
                *("with", "assumptions", number),
                key=False,
                code="circular-assumptions",
                expected="safety; let one of them guarantee its part without waiting for the other",
            )


def warn_of_assumptions(game: KnowledgeGame, view: ScenarioView) -> None:
    """Warn of assumptions that no environment can keep; they imply every guarantee."""
    numbers = game.contradictory_assumptions()
    if numbers is None:
        return
    said = "this assumption" if len(numbers) == 1 else "these assumptions together"
    view.warn(
        f"{said} can never be kept, whatever the agent does: every guarantee follows, also what is impossible",
        "with",
        "assumptions",
        *(numbers if len(numbers) == 1 else ()),
        code="impossible-assumption",
        expected="what an environment can do",
    )


def _groups(agents: Iterable[str], group_of: Mapping[str, str]) -> set[str]:
    return {group_of[each] for each in agents if each in group_of}


def _reachable(start: str, after: Mapping[str, set[str]]) -> set[str]:
    """Return a group and the groups that it waits for, directly or indirectly."""
    found, waiting = {start}, [start]
    while waiting:
        fresh = after.get(waiting.pop(), set()) - found
        found |= fresh
        waiting += fresh
    return found
