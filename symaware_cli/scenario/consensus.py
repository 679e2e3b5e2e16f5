"""Whether groups that are to agree on something can do so with each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from symaware_cli.components.communication.consensus import Consensus
from symaware_cli.core import seconds
from symaware_cli.runtime.simulation import Slot
from symaware_cli.scenario.document import Scenario
from symaware_cli.scenario.problem import quoted
from symaware_cli.scenario.source import Path

_NEEDED = "a consensus needs turns at the same times"


def check_consensus(document: Scenario, time_step: int, slots: Sequence[Slot], report: Callable[..., None]) -> None:
    """Report each consensus that is not on the same terms as that of other groups on the same name.

    Args:
        document: What the scenario says.
        time_step: That of the world, in nanoseconds.
        slots: All components.
        report: Takes the code and the message of a problem, the path, and hints.
    """
    by_name: dict[str, list[Slot]] = {}
    for slot in slots:
        if isinstance(slot.components[0], Consensus):
            by_name.setdefault(slot.components[0].parameters.name, []).append(slot)
    for name, together in by_name.items():
        first, groups = together[0], {together[0].group.name: together[0]}
        for slot in together[1:]:
            same = groups.setdefault(slot.group.name, slot)
            if same is not slot:
                message = f"{_named(same)} has a consensus on {quoted(name)} already"
                report("unsuitable", message, _path(slot), key=True, expected="one for each name")
                continue
            _check_shape(name, slot, first, report)
            _check_turns(document, time_step, slot, first, report)
        for slot in groups.values() if len(groups) > 1 else ():
            _check_order(document, slot, report)


def _check_shape(name: str, slot: Slot, first: Slot, report: Callable[..., None]) -> None:
    """Report a value that has not as many elements as that of another group."""
    shape, wanted = (each.group.known(name).shape[1:] for each in (slot, first))
    if shape != wanted:
        message = f"{_named(first)} has a consensus on {quoted(name)} that is {_form(wanted)}, and here it is "
        where = ("agents", slot.group.name, "knowledge", name)
        report("unsuitable", message + _form(shape), where, key=True, expected=_form(wanted))


def _check_turns(document: Scenario, time_step: int, slot: Slot, first: Slot, report: Callable[..., None]) -> None:
    """Report turns that are at other times than those of another group."""
    own, wanted = slot.timing, first.timing
    period, other = (time_step if each.period is None else each.period for each in (own, wanted))
    for key, one, two in (("period", period, other), ("offset", own.offset, wanted.offset)):
        if one != two:
            said = f"{_NEEDED}: the {key} is {seconds(one):g} s here, and {seconds(two):g} s for {_named(first)}"
            report("unsuitable", said, _place(document, slot, key), key=True, expected=f"{seconds(two):g} [s]")
    for key in ("trigger", "latency"):
        if getattr(own, key) != getattr(wanted, key):
            said = f"{_NEEDED}: the {key} is not that of {_named(first)}"
            report("unsuitable", said, _place(document, slot, key), key=True, expected=f"the same {key} for both")


def _check_order(document: Scenario, slot: Slot, report: Callable[..., None]) -> None:
    """Report turns of which nobody knows whether they will be at the times of those of other groups."""
    timing = slot.timing
    for key, is_uncertain in (
        ("jitter", timing.jitter > 0),
        ("condition", timing.condition is not None),
        ("trigger", timing.trigger is not None and timing.trigger.source is None),
        ("latency", timing.latency.is_drawn),
    ):
        if is_uncertain:
            said = f"{_NEEDED} in all groups, and a {quoted(key)} is a matter of each"
            report("unsuitable", said, _place(document, slot, key), key=True, expected="a period alone")


def _named(slot: Slot) -> str:
    return quoted(f"{slot.group.name}.{slot.name}")


def _path(slot: Slot) -> Path:
    return ("agents", slot.group.name, "components", slot.name)


def _place(document: Scenario, slot: Slot, key: str) -> Path:
    """Where a component has a key, or else the component."""
    use = document.agents[slot.group.name].components[slot.name]
    return (*_path(slot), key) if key in use.model_fields_set else _path(slot)


def _form(shape: tuple[int, ...]) -> str:
    if not shape:
        return "a number"
    return f"a list of {shape[0]}" + ("" if len(shape) == 1 else f", each {_form(shape[1:])}")
