"""Builds the faults of a scenario: resolves their targets, and reports problems with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Environment, nanoseconds
from symaware_cli.runtime.faults import (
    Blind,
    ComponentSelection,
    Cut,
    Effect,
    Fault,
    Freeze,
    MeasurementError,
    Push,
    Restart,
    Restore,
    Slow,
    Stop,
)
from symaware_cli.runtime.simulation import ComponentEntry
from symaware_cli.runtime.timed_changes import SetState
from symaware_cli.scenario.change_builder import ChangeBuilder, ReplacementBuilder
from symaware_cli.scenario.diagnosis import ReportedError
from symaware_cli.scenario.document import ScenarioDocument
from symaware_cli.scenario.fault_section import INSTANTANEOUS, Degradation, Delay, FaultUse, Loss, Placement, Shove
from symaware_cli.scenario.fault_targets import FaultTargets
from symaware_cli.scenario.plugin_factory import PluginFactory
from symaware_cli.scenario.problem import quoted
from symaware_cli.scenario.source import Path
from symaware_cli.scenario.timing_check import TimingCheck, duration_of, trigger_of

#: The faults that need nothing but the components that they concern.
_ON_COMPONENTS: Mapping[str, Callable[[Sequence[ComponentSelection]], Effect]] = {
    "restart": Restart,
    "freeze": Freeze,
    "blind": Blind,
}


class FaultBuilder:
    """Builds the faults of a scenario and reports problems with them."""

    def __init__(
        self,
        check: TimingCheck,
        environment: Environment,
        groups: Sequence[AgentGroup],
        entries: list[ComponentEntry],
        document: ScenarioDocument,
        factory: PluginFactory,
    ) -> None:
        """Prepare.

        Args:
            check: Checks times and events, and takes problems.
            environment: The environment, not initialised yet.
            groups: All groups.
            entries: All component entries, with their timing; `build` adds substitutes.
            document: The validated document.
            factory: Creates components.
        """
        diagnosis = check.diagnosis
        self._data = diagnosis.composition.data
        self._report, self._refuse = diagnosis.report, diagnosis.refuse
        self._check = check
        self._environment = environment
        self._groups = groups
        self._entries = entries
        self._uses = document.faults
        self._targets = FaultTargets(diagnosis, groups, entries)
        self._changes = ChangeBuilder(diagnosis, factory, self._targets)
        self._replacements = ReplacementBuilder(factory, self._targets, check, document, entries)

    def build(self) -> Sequence[Fault]:
        """Build the faults that are sound, in the order of the document; the others are reported."""
        # Other faults act on substitutes as well, wherever they are in the file.
        order = sorted(self._uses, key=lambda name: self._uses[name].replace is None)
        built = {name: self._fault(name, self._uses[name]) for name in order}
        return [fault for name in self._uses if (fault := built[name]) is not None]

    def _fault(self, name: str, use: FaultUse) -> Fault | None:
        """Build a fault; None after a problem."""
        path: Path = ("faults", name)
        trigger = None
        if use.on is not None:
            trigger = trigger_of(use.on.event, use.on.of or "*")
            if trigger.component is not None:
                # A fault belongs to no agent whose component this could be.
                message = f"{quoted(trigger.component)} does not name the agent of the component"
                expected = "`environment`, or the path of a component such as `agents.robot.*.steer`"
                self._report("unknown-source", message, (*path, "on", "of"), expected=expected)
                return None
            self._check.source(trigger, None, self._entries, (*path, "on"))
        try:
            source, text, effect = self._effect(use, path)
        except ReportedError:
            return None
        return Fault(
            name=name,
            text=text,
            source=source,
            effect=effect,
            at=None if use.at is None else nanoseconds(use.at),
            on=trigger,
            lasting=None if use.for_ is None else nanoseconds(use.for_),
        )

    def _effect(self, use: FaultUse, path: Path) -> tuple[str, str, Effect]:
        """The path of a fault's targets, a description for people, and the effect."""
        if use.stop:
            return f"agents.{use.stop}", f"stops {use.stop}", Stop(self._targets.agents(use.stop, (*path, "stop")))
        for key, effect in _ON_COMPONENTS.items():
            if target := getattr(use, key):
                components = self._targets.components(target, (*path, key))
                return f"agents.{target}", f"{key}s {target}", effect(components)
        if use.slow:
            components = self._targets.components(use.slow.of, (*path, "slow", "of"))
            return f"agents.{use.slow.of}", f"slows {use.slow.of}", Slow(components, duration_of(use.slow.latency))
        if use.bias:
            components, bias = self._measurement_error(use.bias.of, use.bias.state, (*path, "bias"), "state")
            return (
                f"agents.{use.bias.of}",
                f"{use.bias.of} measures with an offset",
                MeasurementError(components, bias, 0.0 * bias),
            )
        if use.noise:
            components, noise = self._measurement_error(
                use.noise.of, use.noise.deviation, (*path, "noise"), "deviation"
            )
            return (
                f"agents.{use.noise.of}",
                f"{use.noise.of} measures with noise",
                MeasurementError(components, 0.0 * noise, noise),
            )
        if use.push:
            return self._push(use.push, (*path, "push"))
        if use.reconfigure:
            return self._changes.reconfigure(use.reconfigure, (*path, "reconfigure"))
        if use.replace:
            return self._replacements.build(str(path[1]), use, (*path, "replace"))
        if use.place:
            return self._place(use.place, (*path, "place"))
        if use.inform:
            return self._changes.inform(use.inform, (*path, "inform"))
        if use.restore:
            return self._restore(use.restore, path)
        if use.partition:
            return self._partition(use.partition, (*path, "partition"))
        if use.cut:
            one, other = (
                self._targets.ids(each, (*path, "cut", "between", place)) for place, each in enumerate(use.cut.between)
            )
            self._require_link(one, other, (*path, "cut", "between"))
            text = f"cuts the links between {' and '.join(use.cut.between)}"
            return "exchange", text, Cut([(one, other), (other, one)] if one != other else [(one, other)], loss=1.0)
        if use.degrade:
            worse = use.degrade
            ends = self._ends(worse, (*path, "degrade"))
            text = f"degrades the links from {worse.sender} to {worse.receiver}"
            return "exchange", text, Cut([ends], worse.loss, nanoseconds(worse.delay), worse.bandwidth or math.inf)
        link = use.drop or use.delay
        assert link is not None
        ends = self._ends(link, (*path, "drop" if use.drop else "delay"))
        way = f"messages from {link.sender} to {link.receiver}"
        if isinstance(link, Loss):
            return "exchange", f"drops {way}", Cut([ends], loss=link.probability)
        return "exchange", f"delays {way} by {link.by:g} s", Cut([ends], delay=nanoseconds(link.by))

    def _ends(self, link: Loss | Delay | Degradation, path: Path) -> tuple[frozenset[str], frozenset[str]]:
        """The senders and receivers whose messages a fault affects."""
        senders, receivers = (
            self._targets.ids(link.sender, (*path, "sender")),
            self._targets.ids(link.receiver, (*path, "receiver")),
        )
        self._require_link(senders, receivers, path)
        return senders, receivers

    def _require_link(self, one: frozenset[str], other: frozenset[str], path: Path) -> None:
        """Check that there can be a link between two sets of agents."""
        if len(one | other) < 2:
            (who,) = one
            self._refuse("invalid-value", f"{quoted(who)} has no link with itself", path)

    def _measurement_error(
        self, of: str, values: Sequence[float], path: Path, key: str
    ) -> tuple[list[ComponentSelection], NDArray[np.float64]]:
        components = self._targets.components(of, (*path, "of"))
        return components, self._targets.vector(values, [each.entry.group for each in components], (*path, key))

    def _restore(self, fault: str, path: Path) -> tuple[str, str, Effect]:
        known = [name for name in self._uses if name != path[-1]]
        if fault not in known:
            self._targets.refuse_unknown("other fault", fault, (*path, "restore"), known)
        at, use = self._uses[str(path[-1])].at, self._uses[fault]
        if any(getattr(use, kind) for kind in INSTANTANEOUS):
            said, expected = f"{quoted(fault)} is instantaneous and cannot be restored", "a fault that lasts"
            self._refuse("invalid-value", said, (*path, "restore"), expected=expected)
        if at is not None and use.at is not None:
            begin, now = nanoseconds(use.at), nanoseconds(at)
            end = math.inf if use.for_ is None else begin + nanoseconds(use.for_)
            if not begin < now < end:
                when = f"begins at {begin / 1e9:g} s" if now <= begin else f"is over at {end / 1e9:g} s"
                said = f"at {at:g} s there is nothing to restore: {quoted(fault)} {when}"
                self._refuse("invalid-value", said, (*path, "at"))
        return "faults", f"ends {fault}", Restore(fault)

    def _partition(self, sets: Sequence[Sequence[str]], path: Path) -> tuple[str, str, Effect]:
        """Cut all links between each set of agents and all agents outside of it."""
        all_ids = {id: None for group in self._groups for id in group.ids}
        parts: list[frozenset[str]] = []
        for number, patterns in enumerate(sets):
            members: frozenset[str] = frozenset().union(
                *(self._targets.ids(pattern, (*path, number, place)) for place, pattern in enumerate(patterns))
            )
            twice = [id for id in all_ids if id in members and any(id in part for part in parts)]
            if twice:
                self._refuse("invalid-value", f"{quoted(twice[0])} is in two sets", (*path, number))
            parts.append(members)
        rest = frozenset(all_ids).difference(*parts)
        if len(parts) + bool(rest) < 2:
            self._refuse("invalid-value", "all agents are in one set, so the partition has no effect", path)
        ways = [(part, frozenset(all_ids) - part) for part in (*parts, rest) if part]
        text = f"parts {', '.join('+'.join(each) for each in sets)} from each other and from all others"
        return "exchange", text, Cut(ways, loss=1.0)

    def _push(self, push: Shove, path: Path) -> tuple[str, str, Effect]:
        agents = self._targets.agents(push.of, (*path, "of"))
        change = self._targets.vector(push.by, [each.group for each in agents], (*path, "by"))
        self._require_pushes(path)
        return f"agents.{push.of}", f"pushes {push.of}", Push(agents, change)

    def _place(self, place: Placement, path: Path) -> tuple[str, str, Effect]:
        agents = self._targets.agents(place.of, (*path, "of"))
        state = self._targets.vector(place.state, [each.group for each in agents], (*path, "state"))
        self._require_pushes(path)
        return f"agents.{place.of}", f"sets the state of {place.of}", SetState(agents, state)

    def _require_pushes(self, path: Path) -> None:
        """Check that the world supports sudden changes of states."""
        if type(self._environment).push is Environment.push:
            world = quoted(self._data["environment"]["use"])
            self._refuse("unsuitable", f"the world {world} does not support sudden changes of states", path, key=True)
