"""Reports of scenarios and runs, as lines of text and as tables in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from symaware_cli.world import counted

if TYPE_CHECKING:
    from symaware_cli.engine import Extreme, Pace, RunSummary


#: What contacts do to bodies, in words.
_ON_CONTACT = {
    "pass": "bodies pass through each other",
    "stop": "bodies stop",
    "slide": "bodies slide along each other",
    "end": "the first ends the run",
}


class TextReport(NamedTuple):
    """A headline with facts under it.

    Attributes:
        headline: One line.
        facts: The label and the text of each fact.
    """

    headline: str
    facts: Sequence[tuple[str, str]]

    @property
    def text(self) -> str:
        """The report as lines."""
        return "\n".join([self.headline, *(f"  {label:<14} {fact}" for label, fact in self.facts)])

    @property
    def html(self) -> str:
        """The report as a table without colours, so that it fits every theme."""
        from symaware_cli.views import rendered

        return str(rendered("summary.html", headline=self.headline, facts=self.facts)).strip()


def summary_report(summary: RunSummary) -> TextReport:
    """Return the report of the summary of a run."""
    agents = counted(summary.agents, "agent")
    facts = [
        ("agents", f"{agents}, {summary.steps:,} steps, seed {summary.seed}"),
        ("wall time", f"{summary.wall_time:.2f} s, {_factor(summary.real_time_factor)} real time"),
    ]
    if summary.errors:
        facts.append(("errors", ", ".join(f"{count:,} {name}" for name, count in summary.errors.items())))
    if summary.warnings:
        facts.append(("warnings", ", ".join(f"{count:,} {name}" for name, count in summary.warnings.items())))
    if summary.pace:
        facts.append(("pace", _pace(summary.pace)))
    if summary.goals_reached:
        facts.append(("goals reached", f"{len(summary.goals_reached)} of {agents}"))
    facts.append(("contacts", _contacts(summary)))
    if summary.minimum_separation:
        facts.append(("closest", _extreme(summary.minimum_separation, "m between the outlines of")))
    if summary.highest_risk:
        facts.append(("highest risk", _extreme(summary.highest_risk, "of")))
    facts += [(each.verdict, str(each)) for each in summary.specifications]
    if summary.log:
        size = size_in_words(summary.log_size or 0)
        facts += [("recorded", f"{summary.updates:,} updates, {size}"), ("log", summary.log)]
    return TextReport(f"{summary.name}: {summary.status} after {summary.simulated_time:g} s of simulated time", facts)


def size_in_words(size: int) -> str:
    """Return a number of bytes as a short text."""
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= scale:
            return f"{size / scale:.1f} {unit}"
    return f"{size} B"


def _contacts(summary: RunSummary) -> str:
    # By default bodies pass through each other; without contacts nothing needs to be said.
    said = "" if summary.on_contact == "pass" and not summary.contacts else _ON_CONTACT.get(summary.on_contact or "")
    return f"{summary.contacts}, {said}" if said else f"{summary.contacts}"


def _pace(pace: Pace) -> str:
    kept = f"{pace.factor:g} x real time, {pace.late:,} of {pace.instants:,} instants late"
    return f"{kept}, by {1e3 * pace.worst:.3g} ms at most" if pace.late else kept


def _factor(factor: float) -> str:
    return f"{factor:,.0f} x" if factor >= 10 else f"{factor:.2g} x"


def _extreme(extreme: Extreme, relation: str) -> str:
    return f"{extreme.value:.3g} {relation} {' and '.join(extreme.who)} at {extreme.time:g} s"
