"""The section `promises`: valid promises, and messages about invalid ones."""

from __future__ import annotations

from typing import Any

import pytest
from promising import promising

import symaware_cli as sa


def test_a_promise_is_a_specification_of_the_agent_that_makes_it() -> None:
    summary = sa.scenario(promising()).run(record=False).summary
    assert [(each.name, each.verdict) for each in summary.specifications] == [("stay", "satisfied")]
    summary = sa.scenario(promising(speed=0.8)).run(record=False).summary
    assert [(each.name, each.verdict) for each in summary.specifications] == [("stay", "violated")]


def test_a_promise_of_one_agent_of_several_concerns_its_position_only() -> None:
    content = promising(of="adam.1")
    content["agents"]["adam"] |= {"count": 2, "state": [[9.0, 9.0], [-1.0, 0.0]]}
    del content["agents"]["adam"]["components"]["promises"]
    summary = sa.scenario(content).run(record=False).summary
    assert [(each.name, each.verdict) for each in summary.specifications] == [("stay", "satisfied")]


@pytest.mark.parametrize(
    ("promise", "place", "said"),
    [
        ({"of": "adm"}, "promises.stay.of", "there is no agent or group `adm`"),
        ({"to": ["bob", "eve"]}, "promises.stay.to[1]", "there is no agent or group `eve`"),
        ({"to": "adam"}, "promises.stay.to", "an agent makes this promise only to itself"),
        ({"formula": "always inside(position, rad)"}, "promises.stay.formula", "there is no `rad` here"),
        ({"formula": "eventually inside(position, red)"}, "promises.stay.formula", "a promise is to stay in a region"),
        ({"formula": "always[0, 5] inside(position, red)"}, "promises.stay.formula", "to stay in a region"),
        ({"formula": "always not inside(position, red)"}, "promises.stay.formula", "to stay in a region"),
        ({"formula": "always inside(position, both)"}, "promises.stay.formula", "is made of others"),
        ({"formula": "always inside(position, strip)"}, "promises.stay.formula", "has one coordinate"),
        ({"formula": "always inside(position, moving)"}, "promises.stay.formula", "moves with `bob`"),
        ({"confidence": 0.5}, "promises.stay.confidence", "greater than 0.5"),
        ({"on_broken": "shout"}, "promises.stay.on_broken", "one of distrust, stop, event"),
    ],
)
def test_invalid_promises_are_refused_at_their_place(promise: dict[str, Any], place: str, said: str) -> None:
    with pytest.raises(sa.ScenarioError) as refused:
        sa.scenario(promising(**promise))
    problems = [(each.path, f"{each.message}, not {each.expected}") for each in refused.value.problems]
    found = [message for path, message in problems if path == place]
    assert len(found) == 1, problems
    assert said in found[0]


def test_a_group_that_receives_a_promise_needs_a_monitor() -> None:
    content = promising()
    del content["agents"]["bob"]["components"]["promises"]
    with pytest.raises(sa.ScenarioError, match=r"`bob` has no component `promises\.monitor`"):
        sa.scenario(content)


def test_a_controller_after_the_monitor_would_undo_a_stop() -> None:
    content = promising(on_broken="stop")
    content["agents"]["bob"]["components"]["drive"] = {
        "use": "control.schedule",
        "with": {"inputs": [{"time": 0.0, "input": [0.0, 0.0]}]},
    }
    with pytest.raises(sa.ScenarioError, match="`drive` moves them after that"):
        sa.scenario(content)


@pytest.mark.parametrize(
    ("condition", "said"),
    [
        ("may_meet(adam)", "lacks its `,`"),
        ("may_meet(adam, eve)", "there is no agent `eve`"),
        ("kept(bob) < 1", "promised something to one of these"),
        ("may_meet(adam, bob, adam)", "lacks its `\\)`"),
    ],
)
def test_conditions_name_existing_agents(condition: str, said: str) -> None:
    content = promising()
    content["agents"]["bob"]["components"]["risk"]["condition"] = condition
    with pytest.raises(sa.ScenarioError, match=said):
        sa.scenario(content)


def test_without_promises_their_names_are_unknown() -> None:
    content = promising()
    content["agents"]["bob"]["components"]["risk"]["condition"] = "may_meet(adam, bob)"
    del content["promises"], content["agents"]["bob"]["components"]["promises"]
    with pytest.raises(sa.ScenarioError, match="there is no function `may_meet`"):
        sa.scenario(content)
