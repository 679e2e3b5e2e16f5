"""Plots of offers: the time for which each is open, its bids, holders and outcome."""

from pathlib import Path

import pytest
from checkout import CHECKOUT

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.error import LogError
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.offer_timeline import OfferTimeline
from symaware_cli.views.plotting.plot import plot
from symaware_cli.views.plotting.request import PlotRequest

SCENARIOS = CHECKOUT / "scenarios"
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def errands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "errands.mcap"
    execute(build(SCENARIOS / "errands.yaml"), path)
    return path


def timeline(path: Path, **request: object) -> OfferTimeline:
    (panel,) = gather(open_log(path), PlotRequest(show=("offers",), **request)).panels  # type: ignore[arg-type]
    assert isinstance(panel, OfferTimeline)
    return panel


def test_each_offer_has_a_row_with_its_holders_from_the_events(errands: Path) -> None:
    offers = {each.name: each for each in timeline(errands).offers}
    assert list(offers) == ["painting", "parcel", "flowers", "letter", "piano"]
    changes = [each for each in open_log(errands).events() if each.source == "specifications.flowers"]
    assert [each.name for each in changes] == ["offered", "accepted", "released", "accepted", "satisfied"]
    flowers = offers["flowers"]
    holders = ["", changes[1].data["agent"], "", changes[3].data["agent"]]
    assert [(each.start, each.agent) for each in flowers.phases] == [
        (event.time, holder) for event, holder in zip(changes, holders, strict=False)
    ]
    assert flowers.counts == (4 * SECOND, 24 * SECOND)
    assert (flowers.outcome, flowers.time) == ("satisfied", changes[-1].time)
    assert (offers["piano"].outcome, [each.agent for each in offers["piano"].phases]) == ("rejected", [""])


def test_bids_are_those_with_a_cost(tmp_path: Path) -> None:
    execute(build(SCENARIOS / "auction.yaml"), tmp_path / "log.mcap")
    told = [event for event in open_log(tmp_path / "log.mcap").events() if event.name == "bid"]
    made = sum(cost is not None for event in told for cost in event.data["costs"].values())
    found = timeline(tmp_path / "log.mcap")
    assert sum(len(each.bids) for each in found.offers) == made > 0


def test_offers_undecided_at_the_end_of_the_plot_have_no_outcome(errands: Path) -> None:
    offers = {each.name: each for each in timeline(errands, end=4.5).offers}
    assert "flowers" in offers
    assert offers["flowers"].outcome == ""
    assert offers["flowers"].phases[-1].end <= 4.5 * SECOND


def test_a_log_with_offers_has_the_panel(errands: Path, tmp_path: Path) -> None:
    drawn = plot(open_log(errands), tmp_path / "errands.png")
    assert "offers" in [panel.name for panel in drawn.panels]
    execute(build(SCENARIOS / "shortcut.yaml", ["run.duration=1"]), tmp_path / "log.mcap")
    with pytest.raises(LogError, match="its scenario offers no specifications"):
        gather(open_log(tmp_path / "log.mcap"), PlotRequest(show=("offers",)))
