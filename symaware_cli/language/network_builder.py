"""Builds the network of a scenario from its topology section: topologies, channels, overrides, with checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symaware_cli.core import AgentGroup, Environment, Links, Roster, UnsupportedError, nanoseconds
from symaware_cli.engine import (
    ChannelOverride,
    ChannelParameters,
    Network,
    Topology,
    TopologyError,
    TopologyPhase,
    links_of,
)
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.plugin_factory import words
from symaware_cli.language.problem import dotted, nearest, quoted
from symaware_cli.language.source import Path
from symaware_cli.language.topology_section import LinkUse, TopologyUse
from symaware_cli.world import listed

_SECTION: Path = ("topology",)

#: Parameters of a channel, the parameters that they need, and the messages if those are missing.
_NEEDS = (
    ("queue", ("bandwidth",), "a `queue` has no effect without a `bandwidth`"),
    ("queue_length", ("bandwidth",), "a `queue_length` has no effect without a `bandwidth`"),
    ("drop", ("queue", "queue_length"), "`drop: head` has no effect without a `queue`"),
)


class NetworkBuilder:
    """Builds the network of a scenario and reports problems with it."""

    def __init__(self, diagnosis: Diagnosis, environment: Environment, groups: Sequence[AgentGroup], seed: int) -> None:
        self._report = diagnosis.report
        self._environment = environment
        self._seed = seed
        # Equal to the roster that the environment will have once it is initialised.
        self._roster = environment.roster = Roster({group.name: group.ids for group in groups})

    def build(self, use: TopologyUse, topologies: Mapping[Path, Topology], *, narrowed: bool = False) -> Network | None:
        """Build the network; None after a problem.

        Args:
            use: The topology section of the scenario.
            topologies: The topologies of the section, by path.
            narrowed: Whether a fault limits the bandwidth of links.
        """
        named: dict[Path, tuple[int, str]] = {_SECTION: (0, use.use)}
        for number, each in enumerate(use.changes):
            named[(*_SECTION, "changes", number)] = nanoseconds(each.at), each.use
        sound = self._are_ascending(use)
        if len(topologies) < len(named):
            return None
        phases = {
            # Its random draws are keyed by this text, which is no path of a message.
            path: TopologyPhase(start, topologies[path], ".".join(map(str, path)), name)
            for path, (start, name) in named.items()
        }
        for path, phase in phases.items():
            sound &= self._initialise(phase, path)
        overrides = [self._override(link, number) for number, link in enumerate(use.links)]
        known = [each for each in overrides if each is not None]
        if not sound or len(known) < len(overrides):
            return None
        fixed = {path: self._fixed_links(phase, path) for path, phase in phases.items() if use.connected or use.links}
        if any(links is None and not topologies[path].changes for path, links in fixed.items()):
            return None
        sound = self._have_links(use.links, known, [topologies[path] for path in fixed], list(fixed.values()))
        sound &= self._queues_are_consistent(use.channel, known, narrowed=narrowed)
        if use.connected:
            sound &= self._are_connected(topologies, fixed)
        if not sound:
            return None
        return Network(
            self._roster,
            tuple(phases.values()),
            repeat=None if use.repeat is None else nanoseconds(use.repeat),
            channel=use.channel,
            overrides=known,
            connected=use.connected,
        )

    def links(self, network: Network) -> Links | None:
        """The links of the first topology if it is fixed; None if it changes, or after a problem."""
        return self._fixed_links(network.phase(0), _SECTION)

    def _are_ascending(self, use: TopologyUse) -> bool:
        """Check that changes are in ascending order and before the sequence repeats."""
        before, sound = 0.0, True
        for number, each in enumerate(use.changes):
            path: Path = (*_SECTION, "changes", number, "at")
            if each.at <= before:
                self._report("invalid-value", f"a change at {each.at:g} s is listed after one at {before:g} s", path)
                sound = False
            elif use.repeat is not None and each.at >= use.repeat:
                message = f"a change at {each.at:g} s never happens: the sequence repeats after {use.repeat:g} s"
                self._report("invalid-value", message, path)
                sound = False
            before = max(before, each.at)
        return sound

    def _initialise(self, phase: TopologyPhase, path: Path) -> bool:
        try:
            phase.topology.initialise(self._environment, self._seed)
        except TopologyError as error:
            for each in (error, *error.others):
                self._report_topology_error(each, (*path, "with", *each.path))
            return False
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._report_problem(phase, path, error)
            return False
        if not hasattr(phase.topology, "members"):
            message = f"{quoted(phase.use)} does not call `initialise` of its base `Topology`"
            self._report("broken-plugin", message, (*path, "use"))
            return False
        return True

    def _fixed_links(self, phase: TopologyPhase, path: Path) -> Links | None:
        """The links of a fixed topology; None for one that changes, or after a problem."""
        if phase.topology.changes:
            return None
        try:
            return links_of(phase.topology, 0, len(self._roster))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._report_problem(phase, path, error)
            return None

    def _report_problem(self, phase: TopologyPhase, path: Path, error: BaseException) -> None:
        self._report("broken-plugin", f"{quoted(phase.use)} cannot compute its links: {words(error)}", (*path, "use"))

    def _report_topology_error(self, error: UnsupportedError, path: Path) -> None:
        self._report(
            "unknown-target" if error.name is not None else "invalid-value",
            str(error),
            path,
            expected=f"one of {listed(error.names)}" if error.names else None,
            suggestion=nearest(error.name, error.names) if error.name is not None else None,
        )

    def _override(self, link: LinkUse, number: int) -> ChannelOverride | None:
        ends = []
        for key in ("sender", "receiver"):
            try:
                ends.append(frozenset(self._roster.matching(getattr(link, key))))
            except LookupError:
                known = (*self._roster.groups, *self._roster.ids)
                error = TopologyError(
                    f"there is no agent or group `{getattr(link, key)}`", name=getattr(link, key), names=known
                )
                self._report_topology_error(error, (*_SECTION, "links", number, key))
        return ChannelOverride(ends[0], ends[1], link.channel) if len(ends) == 2 else None

    def _have_links(
        self,
        uses: Sequence[LinkUse],
        overrides: Sequence[ChannelOverride],
        topologies: Sequence[Topology],
        fixed: Sequence[Links | None],
    ) -> bool:
        """Check that each channel override applies to a link, as far as that is known before the run."""
        sound = True
        for number, each in enumerate(overrides):
            said = [key for key in ("receiver", "sender") if key in uses[number].model_fields_set]
            path: Path = (*_SECTION, "links", number, *said[:1])
            if not _is_between_two(each.senders, each.receivers):
                (who,) = each.senders
                self._report("invalid-value", f"`{self._roster.ids[who]}` has no link with itself", path)
                sound = False
            elif not any(_has_link(each, topology, links) for topology, links in zip(topologies, fixed, strict=True)):
                self._report(
                    "invalid-value",
                    f"no link goes from {_named(self._roster, each.senders)} to {_named(self._roster, each.receivers)}",
                    path,
                )
                sound = False
        return sound

    def _queues_are_consistent(
        self, base: ChannelParameters, overrides: Sequence[ChannelOverride], *, narrowed: bool
    ) -> bool:
        """Check that queues have the parameters that they need, in the same channel or in another of the links."""
        parts: list[tuple[Path, ChannelParameters, ChannelOverride | None]] = [((*_SECTION, "channel"), base, None)]
        parts += [
            ((*_SECTION, "links", number, "channel"), each.channel, each) for number, each in enumerate(overrides)
        ]
        sound = True
        for says, needs, message in _NEEDS:
            there = [
                override for _, channel, override in parts if any(getattr(channel, need) is not None for need in needs)
            ]
            if (narrowed and "bandwidth" in needs) or None in there:
                continue
            for path, channel, override in parts:
                said = getattr(channel, says) not in (None, "tail")
                if said and not any(_overlap(override, other) for other in there):
                    where = (*path, says)
                    self._report("invalid-value", f"{quoted(dotted(where))}: {message}", where)
                    sound = False
        return sound

    def _are_connected(self, topologies: Mapping[Path, Topology], fixed: Mapping[Path, Links | None]) -> bool:
        """Check that all fixed topologies are connected."""
        sound = True
        for path, links in fixed.items():
            if links is None:
                continue
            members = topologies[path].members
            numbers = links.parts()[members]
            parts = [[self._roster.ids[index] for index in members[numbers == number]] for number in np.unique(numbers)]
            if len(parts) > 1:
                small = min(parts, key=len)
                message = f"the graph is not connected: it has {len(parts)} parts; one of them is {listed(small, 4)}"
                self._report(
                    "disconnected",
                    message,
                    (*path, "use"),
                    expected="a connected graph, as `topology.connected` requires",
                )
                sound = False
        return sound


def _is_between_two(senders: frozenset[int], receivers: frozenset[int]) -> bool:
    """Whether there is a pair of a sender and a different receiver."""
    return bool(senders and receivers) and len(senders | receivers) > 1


def _has_link(override: ChannelOverride, topology: Topology, links: Links | None) -> bool:
    """Whether there is a link for an override, or may be one if links change."""
    if links is None:
        members = frozenset(topology.members.tolist())
        return _is_between_two(override.senders & members, override.receivers & members)
    wanted = np.zeros(links.count, bool)
    wanted[list(override.receivers)] = True
    return any(wanted[links.of_sender(sender)].any() for sender in override.senders)


def _overlap(one: ChannelOverride | None, other: ChannelOverride | None) -> bool:
    """Whether two channels of a section may apply to the same link; None applies to every link."""
    if one is None or other is None or one is other:
        return True
    return _is_between_two(one.senders & other.senders, one.receivers & other.receivers)


def _named(roster: Roster, agents: frozenset[int]) -> str:
    return listed([roster.ids[index] for index in sorted(agents)], 4)
