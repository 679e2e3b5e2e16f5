"""Warns of specifications that no run of the declared length can satisfy."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from symaware_cli.core import seconds
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.problem import quoted

if TYPE_CHECKING:
    from symaware_cli.specification import Specification


def check_satisfiable(
    specifications: Sequence[Specification],
    begun_by_events: Collection[str],
    duration: int,
    time_step: int,
    diagnosis: Diagnosis,
) -> None:
    """Warn of each specification whose formula no values of its predicates satisfy.

    Args:
        specifications: The specifications.
        begun_by_events: The names of specifications that begin with an event; they are skipped, as the time of the
            event is not known.
        duration: The declared duration of the run, in nanoseconds.
        time_step: The time between two instants, in nanoseconds.
        diagnosis: Takes the warnings.
    """
    from symaware_cli.specification import can_be_satisfied, weakened

    for each in specifications:
        end = duration if each.end is None else min(each.end, duration)
        instants = end // time_step - -(-each.start // time_step) + 1
        if each.name in begun_by_events or each.offer is not None or instants < 1:
            continue
        formula, count = each.formulation.formula, len(each.formulation.atoms)
        if can_be_satisfied(formula, count, instants) is not False:
            continue
        expected = None
        horizon = each.formulation.horizon
        if can_be_satisfied(weakened(formula), count, instants):
            expected = "`weak next` where there may be no next instant: at the last one `next` does not hold"
        elif horizon is not None and horizon >= instants:
            expected = f"a longer run: its windows reach {seconds(horizon * time_step):g} s ahead"
        diagnosis.warn(
            "unsatisfiable",
            f"{quoted(each.name)} cannot be satisfied in a run of {instants:,} instants, for any predicates",
            ("specifications", each.name, "formula"),
            expected=expected,
        )
