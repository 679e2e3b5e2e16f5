"""What agents know of states: exactly, or with a covariance, which a maximal risk requires."""

from __future__ import annotations

from collections.abc import Sequence

from symaware_cli.core import EntryView, ScenarioView


def errs(entry: EntryView) -> bool:
    """Whether a component perceives the own state with errors."""
    return not entry.components[0].perceives().get("own", True)


def gives_exact_state(entry: EntryView, reader: EntryView, step: int) -> bool:
    """Whether a component gives agents their exact states before each turn of another one.

    Args:
        entry: The component.
        reader: The other one, declared after it.
        step: The time step of the world [ns].
    """
    timing = entry.timing
    if not entry.components[0].perceives().get("own", False) or not timing.latency.is_zero:
        return False
    if timing.jitter or timing.trigger is not None or timing.condition is not None:
        return False
    if timing.is_steady(step):
        return True
    period, every = timing.period, step if reader.timing.period is None else reader.timing.period
    return (
        period is not None
        and period > 0
        and every % period == 0
        and (reader.timing.offset - timing.offset) % period == 0
    )


def require_known_states(view: ScenarioView, parameter: str = "maximal_risk") -> None:
    """Report a component that states a maximal risk, and whose agents do not know how uncertain states are.

    Every component that keeps specifications with a stated probability calls this in `check_scenario`.

    Args:
        view: The scenario.
        parameter: The parameter that states the risk; nothing is required if it is None.
    """
    assert view.entry is not None
    given = view.entry.components[0].parameters
    if getattr(given, parameter) is None:
        return
    estimated = any(_gives_covariance(each) for each in view.before)
    why = None if estimated else _why_own_state_is_unknown(view)
    named = [view.document.specifications.get(name) for name in given.specifications]
    if why is None and any(each is not None and each.pairs is not None for each in named):
        why = _why_others_are_unknown(view.before, estimated)
    if why is not None:
        view.report(
            f"with a maximal risk, states are known exactly, or the covariance of their errors is: {why}",
            *("with", parameter),
            expected="`uncertainty.gaussian` before it, which estimates states with covariances, or exact"
            " perception at each step, such as `perception.omniscient`",
        )


def _why_own_state_is_unknown(view: ScenarioView) -> str | None:
    assert view.entry is not None
    for each in view.before:
        if errs(each):
            return f"`{each.name}` perceives the own state with errors"
    if any(gives_exact_state(each, view.entry, view.environment.time_step) for each in view.before):
        return None
    return "nothing before it gives the own state at each of its turns"


def _why_others_are_unknown(before: Sequence[EntryView], estimated: bool) -> str | None:
    seeing = [each for each in before if "others" in each.components[0].perceives()]
    if not seeing:
        return "nothing before it perceives others"
    for each in seeing:
        if not estimated and not each.components[0].perceives()["others"]:
            return f"`{each.name}` perceives others with errors"
    return None


def _gives_covariance(entry: EntryView) -> bool:
    """Whether a component writes the covariance of the own state as the uncertainty of agents."""
    quantities = entry.components[0].series_quantities(entry.group).get("uncertainty", ())
    return len(quantities) == len(entry.group.model.state) ** 2
