"""Checks of topologies: sorted links between members, repeatability, and the same object for equal links."""

from __future__ import annotations

from typing import Any

import numpy as np

from symaware_cli.core import Environment, Links
from symaware_cli.engine import Topology
from symaware_cli.language import KINDS
from symaware_cli.testing.conformance import DeviationList, require_kind, unlike
from symaware_cli.testing.side_effects import fingerprint, own_state, watched
from symaware_cli.testing.small_scenario import (
    Changes,
    SmallScenario,
    check_run,
    report_failure,
    scenario,
    started,
    trace,
)

_KIND = next(each for each in KINDS if each.name == "topology")


def check_topology(kind: type[Topology], changes: Changes | None = None, /, **parameters: Any) -> None:
    """Check a topology with five agents that move and send their states for eight steps.

    The links must be sorted `Links` between members, and the same object as long as they are equal; without `changes`
    that is the whole run. Runs must be equal, and continue alike from a captured state.

    Args:
        kind: The class.
        changes: Values of the scenario by their paths, such as ``{"agents.robot.count": 9}``.
        parameters: The parameters of the topology.

    Raises:
        ConformanceError: A line for each deviation.
    """
    found = require_kind(kind, _KIND)
    content = scenario()
    content["topology"] = {"use": kind, "with": parameters}
    robot = content["agents"]["robot"]
    robot |= {"count": 5, "knowledge": {"goal": [0.5, 0.2]}}
    robot["components"] |= {"tell": {"use": "communication.state"}, "hear": {"use": "communication.inbox"}}
    small = SmallScenario(content, changes, found)
    with started(small.build(_observed(kind, found))) as run:
        trace(run)
        if run.failure is not None:
            report_failure(found, run.failure, "links")
    found.settle()
    check_run(small, "links")
    found.settle()


def _observed(kind: Any, found: DeviationList) -> type:
    """Return a class derived from a topology that observes its links."""
    before: dict[int, Links] = {}

    def links(self: Any, now: int) -> Any:
        world = _world(self.environment)
        with watched(found, "links"):
            value = kind.links(self, now)
        if unlike(world, _world(self.environment)):
            found.add("links", "changes the world", "read positions, and change nothing")
        if not isinstance(value, Links):
            found.add("links", f"returns a {type(value).__name__}", "return `Links`")
            return value
        _check_links(found, self, value)
        state = own_state(self)
        with watched(found, "links"):
            again = kind.links(self, now)
        if not _equal(value, again):
            found.add(
                "links", "returns other links when it is called again at once", "depend on the seed and positions"
            )
        elif unlike(state, own_state(self)):
            found.add("links", "changes itself at a second call at once", "depend on the seed and positions")
        last = before.get(id(self))
        if last is not None and last is not value:
            if _equal(last, value):
                found.add("links", "returns a new object for equal links", "return the same object until they change")
            elif not kind.changes:
                found.add("changes", "is False, and its links change", "declare `changes = True`")
        before[id(self)] = value
        return value

    return type(kind.__name__, (kind,), {"links": links, "__doc__": kind.__doc__, "__module__": kind.__module__})


def _check_links(found: DeviationList, topology: Topology, links: Links) -> None:
    roster = topology.roster
    if links.count != len(roster):
        found.add("links", f"returns links of {links.count} agents", f"give the number of agents: {len(roster)}")
        return
    if (np.diff(links.keys) <= 0).any():
        found.add("links", "returns links that are not sorted, or duplicated", "create them with `Links.of`")
    own = np.flatnonzero(links.senders == links.receivers)
    if len(own):
        who = roster.ids[int(links.senders[own[0]])]
        found.add("links", f"returns a link of {who} to itself", "create them with `Links.of`, which omits it")
    takes_part = getattr(topology, "takes_part", None)
    if takes_part is None:
        found.add("initialise", "does not call the inherited method", "begin with `super().initialise(...)`")
    elif not (takes_part[links.senders] & takes_part[links.receivers]).all():
        found.add("links", "returns links of agents that are not `members`", "use `self.members` and `self.takes_part`")


def _equal(one: Any, other: Any) -> bool:
    return isinstance(other, Links) and one.count == other.count and np.array_equal(one.keys, other.keys)


def _world(environment: Environment) -> dict[str, str]:
    # Links are computed once before the world is initialised.
    return {group.name: fingerprint(environment.state(group)) for group in getattr(environment, "groups", ())}
