"""Promises that are sent: known from the arrival of a message on, which may be late or lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from promising import promising

import symaware_cli as sa
from symaware_cli.log.digest import digest


def telling(channel: dict[str, Any] | None = None, period: float | None = None, **given: Any) -> dict[str, Any]:
    """Return the scenario in which Adam sends his promise to Bob."""
    content = promising(**given)
    tell: dict[str, Any] = {"use": "promises.tell"}
    content["agents"]["adam"]["components"]["tell"] = tell | ({} if period is None else {"period": period})
    if channel is not None:
        content["topology"] = {"use": "complete", "channel": channel}
    return content


def received(content: dict[str, Any], **run: Any) -> list[tuple[float, str | None, str]]:
    found: list[tuple[float, str | None, str]] = []
    events = {
        "promise-received": lambda event: found.append((event.seconds, event.agent, event.text)),
    }
    sa.scenario(content).run(record=False, on_event=events, **run)
    return found


@pytest.mark.parametrize(("channel", "arrives"), [(None, 0.1), ({"delay": 0.35}, 0.4), ({"delay": 0.7}, 0.7)])
def test_a_promise_is_known_once_its_message_arrived(channel: dict[str, Any] | None, arrives: float) -> None:
    content = telling(channel)
    assert received(content) == [(arrives, "bob", "adam promises `stay`: always inside(position, red)")]


def test_a_risk_relies_on_a_promise_from_its_arrival_on(tmp_path: Path) -> None:
    sa.scenario(telling({"delay": 0.5}, speed=0.6)).run(output=tmp_path / "run.mcap", duration=1.0)
    log = sa.open_log(tmp_path / "run.mcap")
    trust, risk = log.series("bob", "trust"), log.series("bob", "risk")
    assert trust.values.tolist() == [[1.0, 0.0], [1.0, 1.0]]
    assert trust.times.tolist() == [0, 500_000_000]
    early = risk.values[risk.times < 500_000_000, 0]
    assert early.max() > 0.2
    assert risk.values[risk.times >= 500_000_000, 0].max() == pytest.approx(0.01)


def test_without_a_message_no_promise_is_relied_on_or_broken() -> None:
    content = telling({"loss": 1.0}, speed=2.0)
    content["agents"]["bob"]["components"]["risk"]["condition"] = "may_meet(adam, bob) and kept(adam) == 1"
    found: list[Any] = []
    sa.scenario(content).run(record=False, on_event={"promise-broken": found.append, "promise-received": found.append})
    assert found == []
    with sa.scenario(content).start() as run:
        run.step(15)
        assert run.awareness("bob", "trust").tolist() == [1.0, 0.0]
        assert len(run.awareness("bob", "risk")) == 1


def test_a_lost_message_delays_a_promise_until_the_next() -> None:
    content = telling({"loss": 0.5}, period=0.3)
    times = [received(content, seed=seed)[0][0] for seed in range(12)]
    assert set(times) > {0.1, 0.4}
    assert all(round((time - 0.1) * 10) % 3 == 0 for time in times)


def test_a_message_is_recorded_with_its_stages(tmp_path: Path) -> None:
    sa.scenario(telling({"delay": 0.2}, period=0.5)).run(output=tmp_path / "run.mcap", duration=1.0)
    told = [each for each in sa.open_log(tmp_path / "run.mcap").communications() if each.kind == "promise"]
    found = [(each.sender, each.receiver, each.stage, each.time / 1e9) for each in told]
    assert found[:2] == [("adam", "bob", "SENT", 0.0), ("adam", "bob", "DELIVERED", 0.2)]
    assert told[0].payload == {"promises": {"stay": {"formula": "always inside(position, red)", "confidence": 0.99}}}


def test_promises_are_sent_to_the_named_agents_only() -> None:
    content = telling()
    content["agents"]["eve"] = {"model": {"use": "single-integrator"}, "state": [8.0, 8.0], "components": {}}
    content["agents"]["bob"]["count"] = 2
    content["agents"]["bob"]["state"] = [[2.0, 0.0], [5.0, 5.0]]
    content["regions"].pop("moving")
    content["promises"]["stay"]["to"] = ["bob.1"]
    assert [agent for _, agent, _ in received(content)] == ["bob.1"]


def test_a_run_continues_from_a_capture_between_sending_and_arrival(tmp_path: Path) -> None:
    with sa.scenario(telling({"delay": 0.5}, speed=0.9)).start() as run:
        for at in (3, 8):
            run.step(at)
            captured = run.capture()
            run.step(8)
            expected = run.awareness("bob", "trust").tolist(), run.awareness("bob", "risk").tolist()
            run.restore(captured)
            run.step(8)
            assert (run.awareness("bob", "trust").tolist(), run.awareness("bob", "risk").tolist()) == expected
            run.restore(captured)
    logs = [tmp_path / "one.mcap", tmp_path / "two.mcap"]
    for log in logs:
        sa.scenario(telling({"delay": 0.2, "loss": 0.3})).run(output=log)
    assert digest(sa.open_log(logs[0])).combined == digest(sa.open_log(logs[1])).combined
    assert sa.verify_log(logs[0]).is_equal


def test_a_sender_without_promises_is_reported() -> None:
    content = promising()
    content["agents"]["bob"]["components"]["tell"] = {"use": "promises.tell"}
    warnings = [each.message for each in sa.scenario(content).validate().warnings]
    assert any("these agents make no promises" in each for each in warnings)
