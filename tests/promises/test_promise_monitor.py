"""Monitoring of promises on beliefs, and its effects on trust and risk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from promising import promising

import symaware_cli as sa
from symaware_cli.evidence import write_report
from symaware_cli.geometry import Pieces
from symaware_cli.language import Catalogue
from symaware_cli.log.digest import digest
from symaware_cli.promises.breach import breach_probability
from symaware_cli.promises.promise import Promise
from symaware_cli.promises.promises_section import RELYING


def events(content: dict[str, Any], **changes: Any) -> list[tuple[float, str | None, float]]:
    found: list[tuple[float, str | None, float]] = []
    sa.scenario(content, changes).run(
        record=False,
        on_event={
            "promise-broken": lambda event: found.append((event.seconds, event.agent, event.data["probability"]))
        },
    )
    return found


def test_a_kept_promise_stays_trusted() -> None:
    assert events(promising()) == []


def test_a_broken_promise_is_noticed_once_when_it_is_probable_enough() -> None:
    found = events(promising(speed=2.0))
    assert [agent for _, agent, _ in found] == ["bob"]
    time, _, probability = found[0]
    assert 0.5 < time <= 1.0
    assert probability > 0.99


def test_a_greater_confidence_waits_for_more_evidence() -> None:
    times = [events(promising(speed=0.8, confidence=confidence))[0][0] for confidence in (0.6, 0.99, 1.0 - 1e-12)]
    assert times == sorted(times)
    assert times[0] < times[-1]


def test_the_event_agrees_with_an_offline_check_of_the_recorded_beliefs(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    sa.scenario(promising(speed=0.9)).run(output=path)
    log = sa.open_log(path)
    believed, promise = log.beliefs("bob", "adam"), Promise("", "", frozenset(), *_shape(), 0.99, "event")
    count = len(believed.times)
    sets = Pieces.of([promise.piece] * count)
    found = breach_probability(believed.values[:, :2], believed.covariances[:, :2, :2], sets)
    assert np.array_equal(found, log.series("bob", "promises.breach").values[:, 0])
    broken = [each for each in log.events() if each.name == "promise-broken"]
    assert [each.time for each in broken] == [believed.times[np.flatnonzero(found > 0.99)[0]]]
    trust = log.series("bob", "trust")
    assert trust.values.tolist() == [[1.0, 1.0], [0.0, 0.0]]
    assert trust.times.tolist() == [0, broken[0].time]


def _shape() -> tuple[Any]:
    from symaware_cli.geometry import Region

    return (Region(box=(-6.0, 0.0, -4.0, 4.0)),)


@pytest.mark.parametrize(
    ("on_broken", "trust", "highest"),
    [("distrust", [0.0, 0.0], 0.9), ("stop", [0.0, 0.0], 0.9), ("event", [0.0, 1.0], None)],
)
def test_the_reaction_to_a_broken_promise_is_declared(
    on_broken: str, trust: list[float], highest: float | None
) -> None:
    content = promising(speed=0.9, on_broken=on_broken)
    content["agents"]["bob"]["components"] = {
        "drive": {"use": "control.schedule", "with": {"inputs": [{"time": 0.0, "input": [0.0, 0.4]}]}},
        **content["agents"]["bob"]["components"],
    }
    content["agents"]["bob"]["components"].pop("risk")
    with sa.scenario(content).start(duration=2.0) as run:
        run.step(19)
        assert run.awareness("bob", "trust").tolist() == trust
        assert run.control("bob").tolist() == ([0.0, 0.0] if on_broken == "stop" else [0.0, 0.4])


def test_trust_is_the_share_of_kept_promises_of_each_other() -> None:
    content = promising(speed=0.9, on_broken="event")
    content["promises"]["wide"] = {"of": "adam", "formula": "always inside(position, wide)", "to": "bob"}
    content["regions"]["wide"] = {"box": [-9.0, 9.0, -9.0, 9.0]}
    content["agents"]["bob"]["components"]["risk"]["condition"] = "kept(adam) < 1 and trust[0] == 0.5"
    with sa.scenario(content).start() as run:
        run.step(19)
        assert run.awareness("bob", "trust").tolist() == [0.5, 1.0]
        assert len(run.awareness("bob", "risk")) == 1


def risk(content: dict[str, Any], steps: int = 5) -> float:
    with sa.scenario(content).start() as run:
        run.step(steps)
        found = run.awareness("bob", "risk")
        return float(found[0]) if len(found) else -1.0


def test_a_risk_pays_for_the_promises_that_it_relies_on() -> None:
    content = promising(speed=0.6, confidence=0.97)
    risks = {}
    for counted in ("ignored", "paid", "if-kept"):
        content["agents"]["bob"]["components"]["risk"]["with"]["promises"] = counted
        risks[counted] = risk(content)
    assert risks["ignored"] > 0.2
    assert risks["paid"] == pytest.approx(0.03)
    assert risks["if-kept"] == 0.0


def test_a_promise_that_allows_a_collision_changes_nothing() -> None:
    content = promising(speed=0.1, formula="always inside(position, wide)")
    content["regions"]["wide"] = {"box": [-6.0, 3.0, -4.0, 4.0]}
    relying = risk(content)
    content["agents"]["bob"]["components"]["risk"]["with"]["promises"] = "ignored"
    assert relying == risk(content)


@pytest.mark.parametrize(("region", "evaluated"), [("blue", False), ("near", True)])
def test_risk_is_evaluated_only_where_promised_regions_meet(region: str, evaluated: bool) -> None:
    content = promising()
    content["promises"]["mine"] = {"of": "bob", "formula": f"always inside(position, {region})", "to": "adam"}
    content["agents"]["bob"]["state"] = [2.5, 0.0]
    content["agents"]["bob"]["components"]["risk"]["condition"] = "may_meet(adam, bob)"
    assert (risk(content) >= 0.0) is evaluated


def test_without_its_own_promise_an_agent_may_meet_any_other() -> None:
    content = promising()
    content["agents"]["bob"]["components"]["risk"]["condition"] = "may_meet(adam, bob)"
    assert risk(content) >= 0.0


def test_a_run_continues_equally_from_a_captured_state() -> None:
    content = sa.scenario(promising(speed=0.9))

    def rest(run: sa.SteppedSimulation, steps: int) -> list[Any]:
        run.step(steps)
        return [run.awareness("bob", "trust").tolist(), run.state("bob").tolist(), run.belief("bob").tolist()]

    for at in (5, 15):
        with content.start() as first:
            first.step(at)
            captured = first.capture()
            expected = rest(first, 19 - at)
        with content.start() as second:
            second.restore(captured)
            assert rest(second, 19 - at) == expected


def test_a_run_repeats_to_the_byte_with_any_order_of_the_file(tmp_path: Path) -> None:
    content = promising(speed=0.9)
    content["promises"]["wide"] = {"of": "adam", "formula": "always inside(position, blue)", "to": ["bob"]}
    turned = {**content, "agents": dict(reversed(content["agents"].items()))}
    turned["promises"] = dict(reversed(content["promises"].items()))
    digests, texts = [], {"resolved.yaml", "scenario/promising.yaml"}
    for number, each in enumerate((content, content, turned)):
        path = tmp_path / f"{number}.mcap"
        sa.scenario(each).run(output=path)
        digests.append(digest(sa.open_log(path)))
    assert digests[0].combined == digests[1].combined
    assert set(digests[0].differences(digests[2])) == texts


def test_a_run_reports_the_results_that_hold_if_promises_are_kept(tmp_path: Path) -> None:
    content = promising(confidence=0.97)
    bob = content["agents"]["bob"]["components"]
    bob["clear"] = {"use": "risk.map", "with": {"within": [-1.0, 3.0, -1.0, 1.0], "promises": "if-kept"}}
    bob["alone"] = {"use": "risk.time-to-collision", "with": {"promises": "ignored"}}
    sa.scenario(content).run(output=tmp_path / "run.mcap", duration=0.5)
    events = [each for each in sa.open_log(tmp_path / "run.mcap").events() if each.name == "promise-relied-on"]
    assert [(each.time, each.text) for each in events] == [
        (0, "relies on `stay` of adam: `risk` includes 0.03 for it; `clear` holds if it is kept")
    ]
    assert events[0].data["paid"] == ["risk"]
    assert events[0].data["if_kept"] == ["clear"]
    write_report(tmp_path / "run.mcap", tmp_path / "run.html", viewer=False)
    assert "`clear` holds if it is kept" in (tmp_path / "run.html").read_text().replace("<code>", "`").replace(
        "</code>", "`"
    )


def test_every_component_with_a_choice_about_promises_reports_how_it_relies_on_them() -> None:
    catalogue = Catalogue()
    found: dict[str, str] = {}
    for listing in catalogue.listings("component"):
        if listing.built_in:
            fields = catalogue.load("component", listing.name).Parameters.model_fields
            if "promises" in fields:
                found[listing.name] = fields["promises"].default
    assert found
    assert {name: RELYING[name] for name in found} == found
