"""The history of offered specifications: the time for which each is open, its bids, holders and outcome."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from symaware_cli.core import nanoseconds, seconds
from symaware_cli.log.logged_events import LoggedEvent
from symaware_cli.views.plotting.line_styles import Chosen, LineStyle
from symaware_cli.views.plotting.request import Window
from symaware_cli.views.views import RunView

#: The possible outcomes of an offer, and the events that begin and end its phases.
ENDS = ("satisfied", "violated", "rejected")
_CHANGES = ("offered", "accepted", "released", *ENDS)


@dataclass(frozen=True)
class OfferPhase:
    """An interval in which an offer is open, or an agent holds it.

    Attributes:
        start: The beginning of the phase [ns].
        end: The end of the phase [ns].
        agent: The agent that holds the specification; empty while it is open.
    """

    start: int
    end: int
    agent: str


@dataclass(frozen=True)
class OfferHistory:
    """The history of an offered specification.

    Attributes:
        name: The name of the specification.
        counts: The first and the last instant of the specification's time [ns].
        phases: The phases in which it was open or held by an agent, in order.
        bids: The times of bids [ns], and the bidding agents.
        outcome: One of `ENDS`; empty if it was undecided at the end.
        time: The time of the outcome, or the end of the plot if it is undecided [ns].
    """

    name: str
    counts: tuple[int, int]
    phases: tuple[OfferPhase, ...]
    bids: tuple[tuple[int, str], ...]
    outcome: str
    time: int


@dataclass(frozen=True)
class OfferTimeline:
    """The specifications offered during a run, as a panel.

    Attributes:
        offers: The offered specifications, in the order of the scenario.
        lines: The styles of the named agents.
    """

    offers: tuple[OfferHistory, ...]
    lines: tuple[LineStyle, ...]

    name = "offers"
    many = False

    def facts(self) -> dict[str, Any]:
        """Return the histories as plain data."""
        return {"panel": self.name, "offers": {each.name: _facts(each) for each in self.offers}}


def offer_timeline(
    events: Iterable[LoggedEvent], run_view: RunView, chosen: Chosen, window: Window
) -> OfferTimeline | None:
    """Return the history of the specifications that were offered up to the end of a window; None if there are none.

    Args:
        events: The events of the log, in order.
        run_view: The run.
        chosen: The agents whose bids are shown.
        window: The interval of time.
    """
    told: dict[str, list[LoggedEvent]] = {name: [] for name in run_view.specifications if name in run_view.offered}
    bids: dict[str, list[tuple[int, str]]] = {name: [] for name in told}
    for event in events:
        name = event.source.removeprefix("specifications.")
        if event.time > window.end:
            break
        if name in told and event.name in _CHANGES:
            told[name].append(event)
        elif event.name == "bid" and isinstance(event.data.get("costs"), dict):
            agent = event.source.removeprefix("agents.").rpartition(".")[0]
            for name, cost in event.data["costs"].items():
                if name in bids and cost is not None and agent in chosen.agents:
                    bids[name].append((event.time, agent))
    offers = tuple(
        _history(name, changes, bids[name], run_view.spans.get(name, (None, None)), window.end)
        for name, changes in told.items()
        if changes
    )
    return OfferTimeline(offers, chosen.lines) if offers else None


def _history(
    name: str,
    changes: Sequence[LoggedEvent],
    bids: Sequence[tuple[int, str]],
    span: tuple[int | None, int | None],
    end: int,
) -> OfferHistory:
    """Return the history of an offer from its events, up to an instant [ns]."""
    first = nanoseconds(float(changes[0].data.get("from", seconds(changes[0].time))))
    ends = [end, None if span[0] is None else first + span[0], span[1]]
    last = min(each for each in ends if each is not None)
    phases: list[OfferPhase] = []
    since, holder, outcome, time = changes[0].time, "", "", end
    for event in changes[1:]:
        if outcome:
            break
        phases.append(OfferPhase(since, event.time, holder))
        since, holder = event.time, str(event.data.get("agent", ""))
        if event.name in ENDS:
            outcome, time = event.name, event.time
        elif event.name == "released":
            holder = ""
    if not outcome:
        phases.append(OfferPhase(since, end if not holder else max(since, last), holder))
    return OfferHistory(name, (first, max(first, last)), tuple(phases), tuple(bids), outcome, time)


def _facts(offer: OfferHistory) -> Mapping[str, Any]:
    return {
        "offered": seconds(offer.phases[0].start),
        "held": [
            {"agent": each.agent, "from": seconds(each.start), "to": seconds(each.end)}
            for each in offer.phases
            if each.agent
        ],
        "bids": len(offer.bids),
        "outcome": offer.outcome or "undecided",
        "time": seconds(offer.time),
        "until": seconds(offer.counts[1]),
    }
