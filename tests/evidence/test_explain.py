"""Explanations: exact comparisons of two arms, the examined candidates, and refusals."""

import itertools
import json
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from planted_causes import planted, promising, putting, talking
from sweeping import symaware

from symaware_cli import branch, load, open_log
from symaware_cli.cli.explain import _lines
from symaware_cli.evidence import BranchError, draw_timeline, explain, write_report
from symaware_cli.evidence.causes import examination
from symaware_cli.evidence.causes.candidate import LinkMessages, beliefs_of
from symaware_cli.evidence.causes.paired_shares import PairedShares, holm
from symaware_cli.language import open_scenario

TOP = Path(__file__).parents[2]


@pytest.mark.parametrize("trials", [4, 9])
@pytest.mark.parametrize("alpha", [0.05, 0.4])
def test_the_interval_is_exact_and_agrees_with_the_test(trials: int, alpha: float) -> None:
    """The coverage, summed over all outcomes, is at least 1 - alpha for all pairs of probabilities of a grid."""
    outcomes = [(b, c) for b in range(trials + 1) for c in range(trials + 1 - b)]
    intervals = {each: PairedShares(trials, *each).interval(alpha) for each in outcomes}
    for each in outcomes:
        shares = PairedShares(trials, *each)
        assert (intervals[each][0] > 0.0) == (shares.probability < alpha)
        assert intervals[each][0] <= shares.difference <= intervals[each][1]
    for p, q in itertools.product((0.0, 0.1, 0.35, 0.5, 0.9), repeat=2):
        if p + q <= 1.0:
            within = [each for each in outcomes if intervals[each][0] - 1e-12 <= p - q <= intervals[each][1] + 1e-12]
            assert sum(_chance(trials, *each, p, q) for each in within) >= 1.0 - alpha - 1e-9


def _chance(trials: int, first: int, second: int, p: float, q: float) -> float:
    """Return the probability of the numbers of futures that only one arm saves, each with the probability p or q."""
    rest = trials - first - second
    ways = math.comb(trials, first) * math.comb(trials - first, second)
    return float(ways * p**first * q**second * max(1.0 - p - q, 0.0) ** rest)


def test_futures_are_counted_in_pairs() -> None:
    shares = PairedShares.of([True, True, False, True], [False, True, True, True])
    assert shares == PairedShares(4, 1, 1, 2)
    assert PairedShares(0, 0, 0).difference == 0.0


def test_holm_counts_hypotheses_without_a_test_as_well() -> None:
    levels = holm([0.2, 0.001, 0.012], 4, 0.05)
    assert levels == [0.05 / 2, 0.05 / 4, 0.05 / 3]
    assert holm([0.02, 0.001, 0.02], 4, 0.05) == [0.05 / 3, 0.05 / 4, 0.05 / 3], "nothing is rejected after a failure"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return next(planted(tmp_path_factory.mktemp("planted"))).log


def test_beliefs_that_cannot_be_wrong_are_no_candidates(log: Path) -> None:
    found = [(each.agent, each.about) for each in beliefs_of(open_scenario(log))]
    assert found == [
        ("walker-0", "cart"),
        ("walker-0", "walker-1"),
        ("walker-1", "cart"),
        ("walker-1", "walker-0"),
    ]


def test_a_row_of_an_explanation_is_a_branch_that_its_command_repeats(log: Path, tmp_path: Path) -> None:
    plans: list[Any] = []
    found = explain(log, before=[0.5, 1.0], within=0.5, futures=16, agents="walker-1", on_plan=plans.append)
    assert [each.candidate.text for each in found.causes] == ["walker-1 about cart"]
    assert found.branches <= plans[0].branches
    row, again = found.rows[0], tmp_path / "again.mcap"
    assert row.best is not None
    assert row.prevented_until(plans[0].instants) == plans[0].instants[-1]
    _, _, written = row.command.partition("--set 'faults.true=")
    branch(log, row.best.instant, {"faults.true": json.loads(written.rstrip("'"))}, again)
    violated = [event.time / 1e9 for event in open_log(again).events() if event.name == "violated"]
    assert not violated or violated[0] > found.violated + 0.5


def test_the_same_explanation_comes_from_the_command_with_its_picture(log: Path, tmp_path: Path) -> None:
    pictures = [tmp_path / "one.svg", tmp_path / "two.svg"]
    said = []
    for picture in pictures:
        command = ["explain", str(log), "--before", "0.5", "--within", "0.2", "--futures", "16", "--agents", "walker-1"]
        said.append(json.loads(symaware(*command, "-o", picture, "--json")))
    assert said[0] == said[1]
    assert said[0]["causes"] == [
        {
            "kind": "belief",
            "text": "walker-1 about cart",
            "agent": "walker-1",
            "about": "cart",
            "part": "state",
            "is_drawn": True,
        }
    ]
    assert pictures[0].read_bytes() == pictures[1].read_bytes()
    assert "walker-1 about cart" in pictures[0].read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"specification": "apar"}, "`apar` was not violated in .*; violated was apart"),
        ({"agents": "cart"}, "nothing in .* can be a cause for cart"),
        ({"kinds": ["messages"]}, "nothing in .* can be a cause: no message was lost or late"),
        ({"kinds": ["faults"]}, "no fault begins before the violation"),
        ({"kinds": ["promises"]}, "no promise is broken before the violation"),
        ({"kinds": ["luck"]}, "kinds of candidates are beliefs, messages, faults, promises; not luck"),
        ({"before": [100.0]}, "no instant of the grid is that long before"),
        ({"budget": 0.001}, "more than the budget of 0.001 s"),
    ],
)
def test_invalid_requests_are_refused_before_any_branch(given: Any, said: str, log: Path) -> None:
    with pytest.raises(BranchError, match=said):
        explain(log, **{"before": [0.5], **given})


def test_a_run_without_a_violation_has_nothing_to_explain(tmp_path: Path) -> None:
    log = tmp_path / "sound.mcap"
    load(TOP / "scenarios" / "hello.yaml").run(output=log)
    with pytest.raises(BranchError, match="no specification was violated"):
        explain(log)


def test_candidates_left_by_screening_without_comparison_are_in_text_json_and_picture(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(examination, "_MOST_TESTED", 1)
    found = explain(log, before=[0.5], within=0.2, futures=16, agents="walker-1")
    assert [(each.candidate.text, each.is_uncompared, each.is_cause) for each in found.rows] == [
        ("walker-1 about cart", False, True),
        ("walker-1 about walker-0", True, False),
    ]
    assert found.to_json()["uncompared"] == [found.rows[1].candidate.to_json()]
    draw_timeline(found, tmp_path / "found.svg")
    drawn = (tmp_path / "found.svg").read_text(encoding="utf-8")
    assert "not compared" in drawn
    assert "no effect" not in drawn
    said = "\n".join(_lines(found, None))
    assert "left 2; only the strongest (1) were compared" in said
    assert "not compared" in said


def report(log: Path) -> str:
    page = log.with_suffix(".html")
    page.unlink(missing_ok=True)
    write_report(log, page)
    return page.read_text(encoding="utf-8")


def test_a_report_shows_the_explanation_beside_the_log_unless_it_is_of_another_one(tmp_path: Path) -> None:
    own = run_with({"put": put(2.0)}, tmp_path)
    beside = tmp_path / "run.explain.json"
    found = explain(own, kinds=["faults"], before=[0.5], within=0.2, futures=16).to_json()
    assert "Why it was violated" not in report(own)
    beside.write_text(json.dumps(found))
    page = report(own)
    assert "Why it was violated" in page
    assert "fault put: 16 of 16 futures saved" in page
    assert "symaware branch" in page
    for changed, said in (
        ({"digest": "0"}, "explains another log"),
        ({"violated": "soon"}, "violated: Input should be a valid number"),
        ({"everything": []}, "everything: List should have at least 1 item"),
    ):
        beside.write_text(json.dumps({**found, **changed}))
        assert said in report(own)
    beside.write_bytes(b"\xff{")
    assert "is not what" in report(own)


def test_messages_that_are_late_are_candidates_and_causes(tmp_path: Path) -> None:
    link = {"sender": "cart", "receiver": "walker-0", "channel": {"delay": 2.5, "jitter": 0.5}}
    log = run_of(talking(20_004, {"channel": {}, "links": [link]}), tmp_path)
    found = explain(log, kinds=["messages"], before=[1.2], within=0.2, futures=16)
    assert [each.candidate.text for each in found.rows] == ["messages cart to walker-0"]
    assert found.rows[0].is_cause
    candidate = found.rows[0].candidate
    assert isinstance(candidate, LinkMessages)
    assert (candidate.lost, candidate.late) == (0, 11)
    assert '"deliver": {"sender": "cart", "receiver": "walker-0"}' in found.rows[0].command
    assert "arrival in time saves" in "\n".join(_lines(found, None))
    assert found.where == "awareness"


def run_of(tree: Any, folder: Path) -> Path:
    file, log = folder / "run.yaml", folder / "run.mcap"
    file.write_text(yaml.safe_dump(tree, sort_keys=False))
    load(file).run(output=log)
    return log


def run_with(faults: dict[str, Any], folder: Path) -> Path:
    return run_of({**putting(30_001), "faults": faults}, folder)


def put(at: float, of: str = "walker-1", aside: float = 0.3) -> dict[str, Any]:
    """Return a fault that puts the walker in the way of the cart, which starts at -4 m and drives at 1 m/s."""
    return {"at": at, "place": {"of": of, "state": [at - 4.0, aside]}}


def test_a_fault_is_a_cause_if_its_absence_saves_the_run_and_its_command_repeats_that(tmp_path: Path) -> None:
    faults = {"early": {"at": 0.5, "push": {"of": "walker-0", "by": [0.0, 0.01]}}, "put": put(2.0)}
    log = run_with({**faults, "later": {"at": 5.0, "stop": "cart"}}, tmp_path)
    found = explain(log, kinds=["faults"], before=[0.5], within=0.5, futures=16)
    assert [each.candidate.text for each in found.causes] == ["fault put"]
    assert [each.text for each in found.over] == ["fault early"], "its absence could not begin any more"
    assert found.where == "declared faults"
    said = "\n".join(_lines(found, None))
    assert "fault put: its absence saves 16 of 16 futures, its presence 0" in said
    assert "fault early, which was over at 0.5 s: see --before" in said
    _, _, written = found.causes[0].command.partition("--set 'faults.true=")
    again = tmp_path / "again.mcap"
    branch(log, found.plan.instants[0], {"faults.true": json.loads(written.rstrip("'"))}, again)
    assert "violated" not in [event.name for event in open_log(again).events() if event.time < found.violated * 1e9 + 1]


def test_faults_of_which_each_suffices_are_named_together(tmp_path: Path) -> None:
    harmless = {f"push-{at}": {"at": 1.6, "push": {"of": "walker-0", "by": [0.0, 0.001 * at]}} for at in range(3)}
    log = run_with({"one": put(2.0), **harmless, "two": put(2.0, "walker-0", -0.4)}, tmp_path)
    plans: list[Any] = []
    found = explain(log, kinds=["faults"], before=[0.5], within=0.5, futures=16, on_plan=plans.append)
    assert not found.causes
    assert found.together is not None
    assert [each.text for each in found.together.candidates] == ["fault one", "fault two"]
    assert found.together.in_this_run
    assert found.branches <= plans[0].branches
    assert found.together.command.endswith("""'faults.true-2={"prevent": "two"}'""")
    assert "fault one, and fault two: making them right saves 16 of 16" in "\n".join(_lines(found, None))
    assert found.to_json()["together"]["in_general"]["established"]


def test_a_broken_promise_is_a_cause_if_keeping_it_saves_the_run_and_its_command_repeats_that(tmp_path: Path) -> None:
    tree = promising(40_001)
    tree["promises"]["far"] = {**tree["promises"]["aside_1"], "formula": "always inside(position, half)"}
    tree["regions"]["half"] = {"box": [-9.0, 9.0, -6.0, -2.5]}
    del tree["promises"]["aside_0"]
    log = run_of(tree, tmp_path)
    found = explain(log, "apart", kinds=["promises"], before=[1.0], within=0.1, futures=16)
    assert [each.candidate.text for each in found.causes] == ["promise aside_1 of walker-1"]
    assert [each.text for each in found.over] == ["promise far of walker-1"], "it was broken too early"
    assert found.where == "promises"
    said = "\n".join(_lines(found, None))
    assert "promise aside_1 of walker-1: keeping it saves 16 of 16 futures, leaving it alone 0" in said
    assert found.over[0].passed.startswith("which was broken at ")
    assert f"promise far of walker-1, {found.over[0].passed}: see --before" in said
    assert found.rows[0].best is not None
    _, _, written = found.causes[0].command.partition("--set 'faults.true=")
    again = tmp_path / "again.mcap"
    branch(log, found.rows[0].best.instant, {"faults.true": json.loads(written.rstrip("'"))}, again)
    broken = {event.source for event in open_log(again).events() if event.name == "violated"}
    assert broken == {"specifications.far"}


def test_a_broken_promise_is_not_explained_by_itself(tmp_path: Path) -> None:
    log = run_of(promising(40_001), tmp_path)
    with pytest.raises(BranchError, match="no promise is broken before the violation"):
        explain(log, "aside_0", kinds=["promises"], before=[0.5])
