"""Checks of consensus components: equal shapes, turns and weights in all groups, and links suited to the weights."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from symaware_cli.components.communication.consensus import Consensus
from symaware_cli.core import Links, seconds
from symaware_cli.network.network import Network
from symaware_cli.runtime.simulation import ComponentEntry
from symaware_cli.scenario.diagnosis import Diagnosis
from symaware_cli.scenario.document import ScenarioDocument, TopologyUse
from symaware_cli.scenario.problem import quoted

_NEEDED = "a consensus needs turns at the same times"


def check_consensus(
    document: ScenarioDocument, time_step: int, entries: Sequence[ComponentEntry], diagnosis: Diagnosis
) -> None:
    """Report each consensus that is incompatible with that of another group on the same name.

    Args:
        document: The validated document.
        time_step: The world's time step, in nanoseconds.
        entries: All component entries.
        diagnosis: Takes problems.
    """
    by_name: dict[str, list[ComponentEntry]] = {}
    for entry in entries:
        if isinstance(entry.components[0], Consensus):
            by_name.setdefault(entry.components[0].parameters.name, []).append(entry)
    for name, together in by_name.items():
        first, groups = together[0], {together[0].group.name: together[0]}
        for entry in together[1:]:
            same = groups.setdefault(entry.group.name, entry)
            if same is not entry:
                message = f"{_named(same)} has a consensus on {quoted(name)} already"
                diagnosis.report("unsuitable", message, entry.section, key=True, expected="one for each name")
                continue
            _check_shape(name, entry, first, diagnosis)
            _check_turns(document, time_step, entry, first, diagnosis)
            _check_weights(entry, first, diagnosis)
        for entry in groups.values() if len(groups) > 1 else ():
            _check_order(document, entry, diagnosis)


def check_metropolis(
    use: TopologyUse,
    network: Network,
    links_of: Callable[[Network], Links | None],
    entries: Sequence[ComponentEntry],
    diagnosis: Diagnosis,
) -> None:
    """Report each consensus with Metropolis weights on links that change or are directed.

    Args:
        use: The topology section of the scenario.
        network: The network built from it.
        links_of: Returns the links of a fixed topology; None after a problem that it reported.
        entries: All component entries.
        diagnosis: Takes problems.
    """
    concerned = [entry for entry in entries if _has_metropolis(entry)]
    if not concerned:
        return
    if use.changes:
        wrong = "do not change, but `topology.changes` replaces them"
    elif network.phase(0).topology.changes:
        wrong = f"do not change, but those of {quoted(use.use)} change"
    elif (links := links_of(network)) is not None and not _are_symmetric(links):
        wrong = f"are symmetric, but some of {quoted(use.use)} go one way only"
    else:
        return
    for entry in concerned:
        message = f"Metropolis weights preserve the mean only if links {wrong}"
        diagnosis.report(
            "unsuitable", message, (*entry.section, "with", "weights"), expected="uniform, or another topology"
        )


def _are_symmetric(links: Links) -> bool:
    back = links.receivers.astype(np.int64) * links.count + links.senders
    return np.array_equal(np.sort(back), links.keys)


def _has_metropolis(entry: ComponentEntry) -> bool:
    component = entry.components[0]
    return isinstance(component, Consensus) and component.parameters.weights == "metropolis"


def _check_weights(entry: ComponentEntry, first: ComponentEntry, diagnosis: Diagnosis) -> None:
    """Report weights, and with Metropolis weights gains, that differ from those of another group."""
    own, wanted = entry.components[0], first.components[0]
    assert isinstance(own, Consensus)
    assert isinstance(wanted, Consensus)
    kinds, gains = (own.parameters.weights, wanted.parameters.weights), (own.gain, wanted.gain)
    for key, one, two in (("weights", *kinds), ("gain", *gains)):
        if one != two and "metropolis" in kinds:
            where = (*entry.section, *(("with", key) if key in own.parameters.model_fields_set else ()))
            said = f"both ends of a link need the same {key}: {one} here, and {two} for {_named(first)}"
            diagnosis.report("unsuitable", said, where, expected=str(two))
            return


def _check_shape(name: str, entry: ComponentEntry, first: ComponentEntry, diagnosis: Diagnosis) -> None:
    """Report a value whose shape differs from that in another group."""
    shape, wanted = (each.group.known(name).shape[1:] for each in (entry, first))
    if shape != wanted:
        message = f"{_named(first)} has a consensus on {quoted(name)} that is {_form(wanted)}, and here it is "
        where = ("agents", entry.group.name, "knowledge", name)
        diagnosis.report("unsuitable", message + _form(shape), where, key=True, expected=_form(wanted))


def _check_turns(
    document: ScenarioDocument, time_step: int, entry: ComponentEntry, first: ComponentEntry, diagnosis: Diagnosis
) -> None:
    """Report turns at other times than those of another group."""
    own, wanted = entry.timing, first.timing
    period, other = (time_step if each.period is None else each.period for each in (own, wanted))
    for key, one, two in (("period", period, other), ("offset", own.offset, wanted.offset)):
        if one != two:
            said = f"{_NEEDED}: the {key} is {seconds(one):g} s here, and {seconds(two):g} s for {_named(first)}"
            where = document.key_path(entry.section, key)
            diagnosis.report("unsuitable", said, where, key=True, expected=f"{seconds(two):g} [s]")
    for key in ("trigger", "latency"):
        if getattr(own, key) != getattr(wanted, key):
            said = f"{_NEEDED}: the {key} is not that of {_named(first)}"
            where = document.key_path(entry.section, key)
            diagnosis.report("unsuitable", said, where, key=True, expected=f"the same {key} for both")


def _check_order(document: ScenarioDocument, entry: ComponentEntry, diagnosis: Diagnosis) -> None:
    """Report turns that may be at other times than those of other groups."""
    timing = entry.timing
    for key, is_uncertain in (
        ("jitter", timing.jitter > 0),
        ("condition", timing.condition is not None),
        ("trigger", timing.trigger is not None and timing.trigger.source is None),
        ("latency", timing.latency.is_drawn),
    ):
        if is_uncertain:
            said = f"{_NEEDED} in all groups, but a {quoted(key)} acts on each separately"
            where = document.key_path(entry.section, key)
            diagnosis.report("unsuitable", said, where, key=True, expected="a period alone")


def _named(entry: ComponentEntry) -> str:
    return quoted(f"{entry.group.name}.{entry.name}")


def _form(shape: tuple[int, ...]) -> str:
    if not shape:
        return "a number"
    return f"a list of {shape[0]}" + ("" if len(shape) == 1 else f", each {_form(shape[1:])}")
