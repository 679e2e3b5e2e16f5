"""From what a scenario says of its topology to a network."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from symaware_cli.core import AgentGroup, Environment, Roster, Topology, TopologyError, nanoseconds
from symaware_cli.network.network import Exemption, Network, Stretch
from symaware_cli.scenario.document import LinkUse, TopologyUse
from symaware_cli.scenario.problem import nearest
from symaware_cli.scenario.source import Path

_SECTION: Path = ("topology",)


class NetworkBuilder:
    """Makes the network of a scenario and reports what is wrong with it."""

    def __init__(
        self, report: Callable[..., None], environment: Environment, groups: Sequence[AgentGroup], seed: int
    ) -> None:
        self._report = report
        self._environment = environment
        self._seed = seed
        # The same that the world will have once it is set up: who is who is known before where everybody is.
        self._roster = environment.roster = Roster({group.name: group.ids for group in groups})

    def build(self, use: TopologyUse, topologies: Mapping[Path, Topology]) -> Network | None:
        """Make a network; None after a problem.

        Args:
            use: What the scenario says.
            topologies: The topologies of the section, by path.
        """
        starts = {_SECTION: 0}
        starts |= {(*_SECTION, "changes", number): nanoseconds(each.at) for number, each in enumerate(use.changes)}
        sound = self._ascend(use)
        if len(topologies) < len(starts):
            return None
        for path, topology in topologies.items():
            sound &= self._initialise(topology, path)
        exemptions = [self._exemption(link, number) for number, link in enumerate(use.links)]
        stretches = [Stretch(start, topologies[path]) for path, start in starts.items()]
        if not sound or None in exemptions or (use.connected and not self._is_connected(stretches, starts)):
            return None
        return Network(
            self._roster,
            stretches,
            repeat=None if use.repeat is None else nanoseconds(use.repeat),
            channel=use.channel,
            exemptions=[each for each in exemptions if each is not None],
            connected=use.connected,
        )

    def _ascend(self, use: TopologyUse) -> bool:
        """Whether changes come one after the other, before everything repeats."""
        before, sound = 0.0, True
        for number, each in enumerate(use.changes):
            path: Path = (*_SECTION, "changes", number, "at")
            if each.at <= before:
                self._report("invalid-value", f"a change at {each.at:g} s comes after one at {before:g} s", path)
                sound = False
            elif use.repeat is not None and each.at >= use.repeat:
                message = f"a change at {each.at:g} s never comes: all begins again after {use.repeat:g} s"
                self._report("invalid-value", message, path)
                sound = False
            before = max(before, each.at)
        return sound

    def _initialise(self, topology: Topology, path: Path) -> bool:
        try:
            topology.initialise(self._environment, self._seed)
        except TopologyError as error:
            self._explain(error, (*path, "with", *error.path))
            return False
        return True

    def _explain(self, error: TopologyError, path: Path) -> None:
        listed = ", ".join(error.names[:6]) + (", ..." if len(error.names) > 6 else "")
        self._report(
            "unknown-target" if error.name is not None else "invalid-value",
            str(error),
            path,
            expected=f"one of {listed}" if error.names else None,
            suggestion=nearest(error.name, error.names) if error.name is not None else None,
        )

    def _exemption(self, link: LinkUse, number: int) -> Exemption | None:
        ends = []
        for key in ("sender", "receiver"):
            try:
                ends.append(frozenset(self._roster.matching(getattr(link, key))))
            except LookupError:
                known = (*self._roster.groups, *self._roster.ids)
                error = TopologyError(
                    f"there is no agent or group `{getattr(link, key)}`", name=getattr(link, key), names=known
                )
                self._explain(error, (*_SECTION, "links", number, key))
        return Exemption(ends[0], ends[1], link.channel) if len(ends) == 2 else None

    def _is_connected(self, stretches: Sequence[Stretch], starts: Mapping[Path, int]) -> bool:
        """Whether those topologies are connected that stay as they are."""
        sound = True
        for path, stretch in zip(starts, stretches, strict=True):
            topology = stretch.topology
            if topology.changes:
                continue
            numbers = topology.links(0).parts()[topology.members]
            parts = [
                [self._roster.ids[index] for index in topology.members[numbers == number]]
                for number in np.unique(numbers)
            ]
            if len(parts) > 1:
                small = min(parts, key=len)
                who = ", ".join(small[:4]) + (", ..." if len(small) > 4 else "")
                message = f"the graph falls into {len(parts)} parts that do not reach each other; one of them is {who}"
                self._report(
                    "disconnected",
                    message,
                    (*path, "use"),
                    expected="a connected one, as `topology.connected` promises",
                )
                sound = False
        return sound
