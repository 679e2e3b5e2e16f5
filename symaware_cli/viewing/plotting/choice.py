"""The choice of the agents that a plot is about, with a line style for each."""

from __future__ import annotations

from collections.abc import Sequence

from symaware_cli.recording.error import UnknownNameError
from symaware_cli.viewing.palette import DISTINCT, agent_colours, hexadecimal
from symaware_cli.viewing.plotting.line_styles import Chosen, LineStyle
from symaware_cli.viewing.views import RunView


def choose(run_view: RunView, names: Sequence[str] = ()) -> Chosen:
    """Choose agents and groups by name, or all agents if no names are given.

    Raises:
        UnknownNameError: An agent or group does not exist.
    """
    wanted = set()
    for name in names:
        if name in run_view.group_views:
            wanted |= set(run_view.group_views[name].agents)
        elif name in run_view.place:
            wanted.add(name)
        else:
            known = [*run_view.group_views, *run_view.place]
            listed = f"; there are {', '.join(run_view.group_views)}" if run_view.group_views else ""
            raise UnknownNameError(f"there is no agent or group {name!r}{listed}", name, known)
    rows = {
        name: [row for row, agent in enumerate(group_view.agents) if not names or agent in wanted]
        for name, group_view in run_view.group_views.items()
    }
    rows = {name: some for name, some in rows.items() if some}
    colours = [run_view.group_views[name].colours[some] for name, some in rows.items()]
    count = sum(len(some) for some in rows.values())
    if count <= DISTINCT < run_view.agent_count:
        # With few chosen agents, each has its own colour, unlike in a replay.
        colours = agent_colours([len(some) for some in rows.values()])
    taken: set[str] = set()
    members: dict[str, list[LineStyle]] = {}
    for (name, some), colour in zip(rows.items(), colours, strict=True):
        for row, each in zip(some, colour, strict=True):
            hue = hexadecimal(each)
            style = LineStyle(run_view.group_views[name].agents[row], hue, count <= DISTINCT and hue in taken)
            members.setdefault(name, []).append(style)
            taken.add(hue)
    return Chosen({name: tuple(lines) for name, lines in members.items()})
