"""How much of each agent a replay shows, chosen by how many there are."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

from symaware_cli.recording.error import LogError
from symaware_cli.viewing.views import RunView

#: Up to so many agents everything is drawn, and each has a tab; nor are there ever more tabs.
FEW = 12
#: Up to so many the intents and uncertainties of all are drawn; beyond, nobody could tell them apart.
MANY = 100
#: How many have a tab where not all do.
TABS = 4
#: How long trails are at least [s].
_SHORTEST = 2.0


@dataclass(frozen=True)
class Detail:
    """What a replay shows.

    Attributes:
        focus: Who has a tab, with what they believe of others.
        labels: Whether all agents have labels; otherwise only the focus has.
        minds: Whether the intents and uncertainties of all are drawn; otherwise only those of the focus.
        curves: Whether risks are plotted agent by agent; otherwise as quantiles of a group.
        trail: How long trails are [s].
        single: Whether one agent was asked for, whose tab is in front then.
        words: The same for people.
    """

    focus: tuple[str, ...]
    labels: bool
    minds: bool
    curves: bool
    trail: float
    single: bool
    words: str


def detail_of(run_view: RunView, agents: Sequence[str] = ()) -> Detail:
    """Choose what to show.

    Args:
        run_view: Who takes part.
        agents: Whom to look at closely; a group stands for its agents. Empty: as many as fit.

    Raises:
        LogError: There is no such agent.
    """
    count = run_view.agent_count
    chosen = tuple(dict.fromkeys(agent for name in agents for agent in _named(run_view, name)))
    focus = chosen[:FEW] or tuple(run_view.agents[: count if count <= FEW else TABS])
    minds = count <= MANY
    share, longest = (0.3, 60.0) if minds else (0.06, 5.0)
    trail = min(max(float(f"{share * run_view.duration:.2g}"), _SHORTEST), longest)
    shown = [f"{count} agent{'s' if count != 1 else ''}: bodies tinted by risk, trails of {trail:g} s"]
    shown.append("intents and uncertainties of all" if minds else f"intents and uncertainties of {_list(focus)} only")
    if count > FEW:
        shown.append("labels of those with a tab only; risk as quantiles")
    who = "everybody" if len(focus) == count else _list(focus)
    hint = "" if chosen or count <= FEW else " (--agents chooses)"
    if len(focus) < len(chosen):
        hint = f" (the first {FEW} of {len(chosen)})"
    return Detail(
        focus=focus,
        labels=count <= FEW,
        minds=minds,
        curves=count <= FEW,
        trail=trail,
        single=len(chosen) == 1,
        words=f"{', '.join(shown)}; tabs for {who}{hint}",
    )


def _named(run_view: RunView, name: str) -> Sequence[str]:
    if name in run_view.group_views:
        return run_view.group_views[name].agents
    if name in run_view.place:
        return [name]
    near = difflib.get_close_matches(name, [*run_view.group_views, *run_view.agents], 1)
    raise LogError(f"there is no agent {name!r}{f'; did you mean {near[0]!r}?' if near else ''}")


def _list(names: Sequence[str]) -> str:
    if len(names) > TABS:
        return f"{', '.join(names[:TABS])} and {len(names) - TABS} more"
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
