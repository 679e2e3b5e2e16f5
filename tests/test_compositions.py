"""Random compositions satisfy the documented invariants; the tool finds and shrinks violations."""

import json
from pathlib import Path
from random import Random
from typing import Any

import pytest

from fuzzing.composer import Composer, is_valid
from fuzzing.invariants import INVARIANTS, check
from fuzzing.shrinking import shrunk
from fuzzing.side_files import write_side_files
from fuzzing.subject import Skipped, Subject, same
from fuzzing.target import Finding
from fuzzing.targets.compositions import TARGET
from fuzzing.vocabulary import vocabulary, words_of
from symaware_cli.language.json_schema import scenario_schema

SMALL: dict[str, Any] = {
    "symaware": 1,
    "name": "composed",
    "seed": 3,
    "run": {"duration": 0.5},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "car": {
            "count": 2,
            "entity": {"shape": {"circle": {"radius": 0.3}}},
            "model": {"use": "unicycle", "with": {"process_noise": 0.1}},
            "state": {"each": [[0, 0, 0], [1.5, 0, 3.14]]},
            "knowledge": {"goal": {"all": [2, 0]}},
            "components": {
                "see": {"use": "perception.range", "with": {"range": 3.0}},
                "steer": {"use": "control.go-to-goal"},
            },
        }
    },
    "regions": {"zone": {"box": [0, 4, -2, 2]}},
    "specifications": {"in": {"each": "car", "formula": "always inside(position, zone)"}},
}

STARTING = {"merged", "by_workers", "swept_by_workers", "reported"}
"""Invariants that start processes, or draw."""


def checked(number: int, folder: Path, invariants: list[str] | None) -> list[Finding]:
    content = json.loads(TARGET.make(Random(f"gate {number}")))
    _, findings = check(Subject(content["scenario"], folder, content["seed"]), invariants)
    return findings


def test_every_invariant_holds_of_a_small_scenario(tmp_path: Path) -> None:
    names = [invariant.__name__ for invariant in INVARIANTS if invariant.__name__ not in STARTING]
    counts, findings = check(Subject(SMALL, tmp_path, 1), names)
    assert [(each.kind, str(each)) for each in findings] == []
    assert [name for name in names if not counts[name]] == []


@pytest.mark.slow
def test_invariants_of_processes_hold_of_a_small_scenario(tmp_path: Path) -> None:
    counts, findings = check(Subject(SMALL, tmp_path, 1), sorted(STARTING))
    assert [(each.kind, str(each)) for each in findings] == []
    assert [name for name in STARTING if not counts[name]] == []


@pytest.mark.slow
@pytest.mark.parametrize("number", range(16))
def test_composed_scenarios_keep_every_promise(number: int, tmp_path: Path) -> None:
    (tmp_path / "prepared").mkdir()
    (tmp_path / "files").mkdir()
    TARGET.prepare(tmp_path / "prepared")
    findings = checked(number, tmp_path / "files", None)
    assert [(each.kind, each.where, str(each)[-2000:]) for each in findings] == []


#: Words of the language that no scenario has which is drawn, and why.
NOT_DRAWN = {
    "ComponentUse.own": "`tests/language/test_own_parameters.py` compares scenarios with and without",
    "ContractUse.": "runs with contracts are neither batched nor spread: `tests/evidence/test_contracts.py`",
    "SpecificationUse.of=awareness": "the same, as contracts are stated so",
    "FreePlacement.": "whether there is room depends on the world: `tests/language/test_free_places.py`",
    "PerAgent.free": "the same",
    "PromiseUse.on_broken": "needs a promise that is valid: `tests/promises/test_promise_monitor.py`",
    "fault:keep": "needs a promise that is valid: `tests/promises/test_keep.py`",
    "FaultUse.keep": "the same",
    "fault:believe.part=risk": "refused with a reason: `tests/engine/runtime/test_true_beliefs.py`",
    "fault:believe.part=uncertainty": "the same",
    "ScenarioDocument.extends": "the invariant `in_several_files` writes scenarios that extend a file",
    "RoadsForm.centre": "regions beside those of lanes: `tests/roads/test_road_section.py`",
    "MapForm.height": "about the files of maps: `tests/maps`",
    "MapForm.resolution": "the same",
    "MapForm.unknown": "the same",
    "LaneForm.left": "the names of other lanes: `tests/roads`",
    "LaneForm.right": "the same",
    "LaneForm.successors": "the same",
    "GroupSection.like": "`tests/language/test_group_templates.py` compares scenarios with those written in full",
    "ActionBounds.": "a run does not use it: `tests/learning` compares episodes with runs",
    "LearningUse.": "the same",
    "NearestOthers.": "the same",
    "ScenarioDocument.recordings": "about recorded files: `tests/bags`",
    "RecordingFile.": "the same",
    "RecordedBody.": "the same",
    "RewardTerm.": "the same",
    "SignalValues.": "the same",
    "ScenarioDocument.plugins": "a file of code has to be trusted first: `tests/plugin_files`",
    "ScenarioDocument.templates": "as for `GroupSection.like`",
    "ScenarioDocument.subscribers": "no installed plugin has a function to call",
    "SubscriberUse.": "the same",
    "environment:pybullet.gui": "a window needs a screen",
    "transport:memory.members": "a run of two processes has no more members than any transport has room for",
    "transport:tcp.members": "the same",
    "transport:zenoh.members": "the same",
}


@pytest.mark.slow
def test_every_word_of_the_language_can_be_drawn() -> None:
    """What is valid is not asked here, so that every section, plugin and option is drawn within a minute."""
    schema = scenario_schema(built_in_only=True)[0]
    composer = Composer(schema, lambda tree: True)
    wanted = {word for word in vocabulary(schema) if not word.startswith(tuple(NOT_DRAWN))}
    drawn: set[str] = set()
    for number in range(4300):
        drawn |= words_of(composer.scenario(Random(number)), schema)
        if wanted <= drawn:
            break
    never = vocabulary(schema) - drawn
    left = sorted(word for word in never if not word.startswith(tuple(NOT_DRAWN)))
    assert left == [], "\n".join(left)
    assert [word for word in NOT_DRAWN if not any(each.startswith(word) for each in never)] == []


#: What is drawn, and needs more than a drawn scenario to be valid: contracts and promises of agents that are there, the
#: file of a recording, an FMU that is trusted, the lanes of a road, a lidar beside the messages about its map.
NEEDS_MORE = {
    *("ScenarioDocument.promises", "PromiseUse."),
    *("ScenarioDocument.contracts", "RecordedTopic.", "component:perception.bag", "use:perception.bag"),
    *("model:fmu", "use:fmu"),
    *("component:promises.monitor", "use:promises.monitor", "component:promises.tell", "use:promises.tell"),
    *(f"{key}:control.{name}" for key in ("component", "use") for name in ("lane-", "car-following")),
    *("component:communication.map", "use:communication.map"),
}


@pytest.mark.slow
def test_valid_scenarios_have_most_of_the_language(tmp_path: Path) -> None:
    """A feature that is drawn so that it is hardly ever valid would not be tested.

    What adds no word to those of the valid scenarios so far is left out without being built, for that is what costs.
    """
    schema = scenario_schema(built_in_only=True)[0]
    write_side_files(tmp_path)
    left_out = (*NOT_DRAWN, *NEEDS_MORE)
    asked = [word for word in vocabulary(schema) if not word.startswith(left_out)]
    least = {"use:": 0.9, "FaultUse.": 0.75, "ScenarioDocument.": 0.8, "formula:": 0.9, "": 0.5}
    drawn: set[str] = set()
    has_foundation = False

    def is_wanted(tree: dict[str, Any]) -> bool:
        nonlocal has_foundation
        words = words_of(tree, schema)
        if (has_foundation and words <= drawn) or not is_valid(tree, tmp_path / "draft.yaml", 60):
            return False
        has_foundation = True
        drawn.update(words)
        return True

    def lacking() -> dict[str, list[str]]:
        """The words that were not drawn of each kind of which too many were not."""
        words = {kind: {word for word in asked if word.startswith(kind)} for kind in least}
        few = [kind for kind, share in least.items() if len(words[kind] & drawn) < share * len(words[kind])]
        return {kind: sorted(words[kind] - drawn) for kind in few}

    composer = Composer(schema, is_wanted)
    for number in range(120):
        has_foundation = False
        composer.scenario(Random(number))
        if not lacking():
            break
    assert lacking() == {}


def test_a_word_of_the_language_is_found_at_every_place() -> None:
    schema = scenario_schema(built_in_only=True)[0]
    words = words_of(
        {
            **SMALL,
            "faults": {"it": {"stop": "car.0", "on": {"event": "contact"}}},
            "topology": {"use": "ring", "channel": {"delay": {"uniform": [0, 1]}}, "connected": True},
        },
        schema,
    )
    assert words <= vocabulary(schema) | {"formula:zone"}
    assert {"FaultUse.stop", "event:contact", "use:ring", "ProbabilityDistribution.uniform", "formula:inside"} <= words
    assert {"component:perception.range.range", "TopologyUse.connected=True", "PerAgent.each"} <= words
    assert not {"FaultUse.freeze", "formula:until", "ProbabilityDistribution.normal", "use:star"} & words


def test_a_second_run_that_differs_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    subject = Subject(SMALL, tmp_path, 1)
    assert subject.result.status == "finished"
    subject.path.write_text(subject.path.read_text().replace('"seed": 3', '"seed": 4'))
    _, findings = check(subject, ["twice"])
    assert [each.kind for each in findings] == ["twice"]


def test_values_are_compared_with_nan_equal_to_itself() -> None:
    same("it", {"a": [1.0, float("nan")]}, {"a": [1.0, float("nan")]})
    with pytest.raises(Finding):
        same("it", {"a": [1.0, 2.0]}, {"a": [1.0, float("nan")]})


def test_a_scenario_is_shrunk_to_what_breaks() -> None:
    """Here, perception beside a state breaks something."""

    def breaks(tree: dict[str, Any]) -> bool:
        car = tree.get("agents", {}).get("car", {})
        return "state" in car and "see" in car.get("components", {})

    assert shrunk(SMALL, breaks) == {"agents": {"car": {"state": {}, "components": {"see": {}}}}}


def test_an_invariant_that_does_not_apply_is_no_finding(tmp_path: Path) -> None:
    counts, findings = check(Subject({**SMALL, "recording": {"interval": 0.2}}, tmp_path, 1), ["checked"])
    assert not findings
    assert counts["checked skipped: not every step is recorded"] == 1
    assert issubclass(Skipped, Exception)
