"""Checks of a consensus in a whole scenario: the same shape, turns and weights in all groups, and suitable links."""

from __future__ import annotations

from typing import Any

import numpy as np

from symaware_cli.core import EntryView, Links, ScenarioView, seconds

_NEEDED = "a consensus needs turns at the same times"


def check_consensus(view: ScenarioView) -> None:
    """Report parameters that contradict the consensus of other groups on the same name, and unsuitable links."""
    assert view.entry is not None
    own: Any = view.entry.components[0]
    name = own.parameters.name
    together = [
        each
        for each in view.entries
        if type(each.components[0]) is type(own) and each.components[0].parameters.name == name
    ]
    earlier = together[: together.index(view.entry)]
    same = next((each for each in earlier if each.group is view.entry.group), None)
    if same is not None:
        view.report(f"{_named(same)} has a consensus on `{name}` already", expected="one for each name")
        return
    if earlier:
        first = earlier[0]
        _check_shape(name, first, view)
        _check_turns(first, view)
        _check_weights(first, view)
    if len({each.group.name for each in together}) > 1:
        _check_order(view)
    if own.parameters.weights == "metropolis":
        _check_links(view)


def _check_links(view: ScenarioView) -> None:
    """Report Metropolis weights on links that change or are directed."""
    use = view.document.topology
    if use is None:
        return
    if use.changes:
        wrong = "do not change, but `topology.changes` replaces them"
    elif view.network_changes:
        wrong = f"do not change, but those of `{use.use}` change"
    elif view.links is not None and not _are_symmetric(view.links):
        wrong = f"are symmetric, but some of `{use.use}` go one way only"
    else:
        return
    message = f"Metropolis weights preserve the mean only if links {wrong}"
    view.report(message, "with", "weights", key=False, expected="uniform, or another topology")


def _are_symmetric(links: Links) -> bool:
    back = links.receivers.astype(np.int64) * links.count + links.senders
    return np.array_equal(np.sort(back), links.keys)


def _check_weights(first: EntryView, view: ScenarioView) -> None:
    """Report weights, and with Metropolis weights gains, that differ from those of another group."""
    assert view.entry is not None
    own, wanted = view.entry.components[0], first.components[0]
    kinds, gains = (own.parameters.weights, wanted.parameters.weights), (own.gain, wanted.gain)
    for key, one, two in (("weights", *kinds), ("gain", *gains)):
        if one != two and "metropolis" in kinds:
            said = f"both ends of a link need the same {key}: {one} here, and {two} for {_named(first)}"
            view.report(said, "with", key, key=False, expected=str(two))
            return


def _check_shape(name: str, first: EntryView, view: ScenarioView) -> None:
    """Report a value whose shape differs from that in another group."""
    assert view.entry is not None
    group = view.entry.group
    shape, wanted = (each.known(name).shape[1:] for each in (group, first.group))
    if shape != wanted:
        message = f"{_named(first)} has a consensus on `{name}` that is {_form(wanted)}, and here it is {_form(shape)}"
        view.report(message, "knowledge", name, section=("agents", group.name), expected=_form(wanted))


def _check_turns(first: EntryView, view: ScenarioView) -> None:
    """Report turns at other times than those of another group."""
    assert view.entry is not None
    own, wanted, step = view.entry.timing, first.timing, view.environment.time_step
    period, other = (step if each.period is None else each.period for each in (own, wanted))
    for key, one, two in (("period", period, other), ("offset", own.offset, wanted.offset)):
        if one != two:
            said = f"{_NEEDED}: the {key} is {seconds(one):g} s here, and {seconds(two):g} s for {_named(first)}"
            view.report(said, key, expected=f"{seconds(two):g} [s]")
    for key in ("trigger", "latency"):
        if getattr(own, key) != getattr(wanted, key):
            said = f"{_NEEDED}: the {key} is not that of {_named(first)}"
            view.report(said, key, expected=f"the same {key} for both")


def _check_order(view: ScenarioView) -> None:
    """Report turns that may be at other times than those of other groups."""
    assert view.entry is not None
    timing = view.entry.timing
    for key, is_uncertain in (
        ("jitter", timing.jitter > 0),
        ("condition", timing.condition is not None),
        ("trigger", timing.trigger is not None and timing.trigger.source is None),
        ("latency", timing.latency.is_drawn),
    ):
        if is_uncertain:
            said = f"{_NEEDED} in all groups, but a `{key}` acts on each separately"
            view.report(said, key, expected="a period alone")


def _named(entry: EntryView) -> str:
    return f"`{entry.group.name}.{entry.name}`"


def _form(shape: tuple[int, ...]) -> str:
    if not shape:
        return "a number"
    return f"a list of {shape[0]}" + ("" if len(shape) == 1 else f", each {_form(shape[1:])}")
