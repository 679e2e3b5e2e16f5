"""Level of detail of a replay, chosen by the number of agents."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

from symaware_cli.log import LogError
from symaware_cli.views.views import RunView
from symaware_cli.world import counted, listed

#: Up to this number of agents everything is drawn and each has a tab; also the maximum number of tabs.
FEW = 12
#: Up to this number, the intents and uncertainties of all agents are drawn; with more, they could not be told apart.
MANY = 100
#: Number of tabs if not all agents have one.
TABS = 4
#: Minimum duration of trails [s].
_SHORTEST = 2.0


@dataclass(frozen=True)
class Detail:
    """The level of detail of a replay.

    Attributes:
        focus: The agents that have a tab with their beliefs about others.
        labels: Whether all agents have labels; otherwise only those in focus.
        awareness: Whether the intents and uncertainties of all agents are drawn; otherwise only of those in focus.
        curves: Whether risks are plotted per agent; otherwise as quantiles of a group.
        trail: Duration of trails [s].
        single: Whether a single agent was requested, whose tab is then selected.
        words: A description for users.
    """

    focus: tuple[str, ...]
    labels: bool
    awareness: bool
    curves: bool
    trail: float
    single: bool
    words: str


def detail_of(run_view: RunView, agents: Sequence[str] = ()) -> Detail:
    """Choose the level of detail.

    Args:
        run_view: The run to show.
        agents: The agents that have a tab; a group stands for its agents. Empty: as many as fit.

    Raises:
        LogError: An agent does not exist.
    """
    count = run_view.agent_count
    chosen = tuple(dict.fromkeys(agent for name in agents for agent in _named(run_view, name)))
    focus = chosen[:FEW] or tuple(run_view.agents[: count if count <= FEW else TABS])
    awareness = count <= MANY
    share, longest = (0.3, 60.0) if awareness else (0.06, 5.0)
    trail = min(max(float(f"{share * run_view.duration:.2g}"), _SHORTEST), longest)
    shown = [f"{counted(count, 'agent')}: bodies tinted by risk, trails of {trail:g} s"]
    whose = "all" if awareness else f"{_list(focus)} only"
    shown.append(f"intents and uncertainties of {whose}")
    if count > FEW:
        shown.append("labels of those with a tab only; risk as quantiles")
    who = "all agents" if len(focus) == count else _list(focus)
    hint = "" if chosen or count <= FEW else " (--agents chooses)"
    if len(focus) < len(chosen):
        hint = f" (the first {FEW} of {len(chosen)})"
    return Detail(
        focus=focus,
        labels=count <= FEW,
        awareness=awareness,
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
        return listed(names, TABS)
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
