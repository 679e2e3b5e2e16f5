"""Explanations: exact comparisons of two arms, the examined candidates, and refusals."""

import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from planted_causes import planted, promising, putting, talking
from sweeping import symaware

from symaware_cli import branch, load, open_log
from symaware_cli.cli.explain import _lines
from symaware_cli.evidence import BranchError, draw_timeline, explain, write_report
from symaware_cli.evidence.causes import examination
from symaware_cli.evidence.causes.candidate import LinkMessages, beliefs_of
from symaware_cli.evidence.causes.component_alternatives import component_alternatives, possible_together
from symaware_cli.evidence.causes.explanation_marks import Causes
from symaware_cli.evidence.causes.paired_shares import PairedShares, holm
from symaware_cli.language import open_scenario
from symaware_cli.views.detail import detail_of
from symaware_cli.views.scene.marks import Journal, Lines
from symaware_cli.views.scene.scene import Scene
from symaware_cli.views.views import run_view_of

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
        ({"specification": "apar"}, "`apar` was not violated in .*; apart was"),
        ({"agents": "cart"}, "nothing in .* can be a cause for cart"),
        ({"kinds": ["messages"]}, "nothing in .* can be a cause: no message was lost or late"),
        ({"kinds": ["faults"]}, "no fault begins before the violation"),
        ({"kinds": ["promises"]}, "no promise is broken before the violation"),
        ({"kinds": ["components"]}, r"no component has an alternative \(--over\)"),
        (
            {"kinds": ["faults"], "over": ["agents.cart.components.see.use=perception.omniscient"]},
            "do not include comp",
        ),
        ({"over": ["agents.cart.state=[0, 0]"]}, "expected a component, agents.GROUP.components.NAME.use"),
        ({"kinds": ["luck"]}, "kinds of candidates are beliefs, messages, faults, promises, components; not luck"),
        ({"before": [100.0]}, "no instant of the grid is that early"),
        ({"budget": 0.001}, "more than the budget of 0.001 s"),
    ],
)
def test_invalid_requests_are_refused_before_any_branch(given: Any, said: str, log: Path) -> None:
    with pytest.raises(BranchError, match=said):
        explain(log, **{"before": [0.5], **given})


def test_a_run_without_a_violation_cannot_be_explained(tmp_path: Path) -> None:
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


def test_an_alternative_of_a_component_is_a_cause_if_it_saves_more_futures_than_a_restart(
    log: Path, tmp_path: Path
) -> None:
    over = ["agents.walker-1.components.see.use=perception.self,perception.omniscient"]
    plans: list[Any] = []
    found = explain(log, kinds=["components"], over=over, before=[0.5], within=0.1, futures=16, on_plan=plans.append)
    assert [each.candidate.text for each in found.causes] == ["walker-1.see as perception.omniscient"]
    assert [each.candidate.text for each in found.rows[1:]] == ["walker-1.see as perception.self"]
    assert len(found.everything) == 2, "two alternatives of a component are not made together"
    assert found.where == "components with alternatives"
    assert found.branches <= plans[0].branches
    assert found.rows[0].candidate.document(truth=False) == {"restart": "walker-1.see"}
    said = "\n".join(_lines(found, None))
    assert (
        "walker-1.see as perception.omniscient: the alternative saves 16 of 16 futures, a restart of the comp" in said
    )
    _, _, written = found.causes[0].command.partition("--set 'faults.true=")
    again = tmp_path / "again.mcap"
    branch(log, found.plan.instants[0], {"faults.true": json.loads(written.rstrip("'"))}, again)
    violated = [event.seconds for event in open_log(again).events() if event.name == "violated"]
    assert not violated or violated[0] > found.violated + 0.1


def test_alternatives_of_a_component_and_of_its_parameters_are_candidates_in_sets_of_their_own(log: Path) -> None:
    see = "agents.walker-1.components.see"
    over = [f"{see}.with.position_noise=0.05,0.1", f"{see}.use=perception.self", "agents.cart.components.see.use=a.b"]
    found = component_alternatives(log, over)
    assert [each.text for each in found] == [
        "walker-1.see with position_noise=0.05",
        "walker-1.see with position_noise=0.1",
        "walker-1.see as perception.self",
        "cart.see as a.b",
    ]
    assert possible_together(found) == [[found[0], found[3]], [found[1]], [found[2]]]


def test_no_placebo_is_tried_where_truth_saves_too_few_futures(tmp_path: Path) -> None:
    own = run_with({"put": put(2.0)}, tmp_path)
    found = explain(own, kinds=["beliefs"], before=[0.3], within=0.1, futures=16)
    (all_at_once,) = found.everything
    assert not all_at_once.has_placebo
    assert (all_at_once.shares.first, all_at_once.shares.trials) == (0, 10), "10 of 16 are lost, so 7 cannot be saved"
    assert found.to_json()["everything"][0]["saved_by_placebo"] is None
    said = "\n".join(_lines(found, None))
    assert "truth saves only 0 of 10 futures" in said
    assert "none in awareness: all at once save too few futures" in said
    own.with_name("run.explain.json").write_text(json.dumps(found.to_json()))
    assert "0 of 10 futures saved, too few for a difference" in report(own)


def test_a_replay_shows_the_causes_of_the_explanation_beside_the_log(tmp_path: Path) -> None:
    own = run_with({"put": put(2.0)}, tmp_path)
    found = explain(own, kinds=["beliefs", "faults"], before=[0.3], within=0.1, futures=16).to_json()
    assert not causes_drawn(own)
    row = next(each for each in found["candidates"] if each["cause"])
    assert row["candidate"]["text"] == "fault put"
    # The marks of a belief, since a fault is about no pair of agents.
    row["candidate"] = {"text": "walker-1 about cart", "kind": "belief", "agent": "walker-1", "about": "cart"}
    beside = own.with_name("run.explain.json")
    beside.write_text(json.dumps(found))
    lines = [each for each in causes_drawn(own) if isinstance(each, Lines)]
    times, shown = (np.concatenate([getattr(each, name) for each in lines]) for name in ("times", "counts"))
    begin, end = found["plan"]["instants"][0], found["violated"]
    assert [(time >= begin * 1e9 - 1, time <= end * 1e9 + 1) for time in times[shown > 0]] == [
        (True, True)
    ] * shown.sum()
    assert times.min() <= begin * 1e9 + 1
    assert not shown[times > end * 1e9].any()
    (journal,) = [each for each in causes_drawn(own) if isinstance(each, Journal) and len(each.times)]
    assert journal.kinds[0] == "cause"
    assert journal.texts[0].startswith("saves this run, 16 of 16 futures (placebo ")
    beside.write_text(json.dumps({**found, "digest": "0"}))
    (journal,) = causes_drawn(own)
    assert isinstance(journal, Journal)
    assert list(journal.texts) == ["explains another log, and is not shown"]


def causes_drawn(log: Path) -> list[Any]:
    """Return the marks of a whole replay by the drawing of causes."""
    opened = open_log(log)
    run_view = run_view_of(opened)
    scene = Scene(run_view, detail_of(run_view, ()), [Causes])
    return [mark for chunk in scene.chunk_reader().chunks(opened.messages()) for mark in scene.marks(chunk)]


def report(log: Path) -> str:
    page = log.with_suffix(".html")
    page.unlink(missing_ok=True)
    write_report(log, page)
    return page.read_text(encoding="utf-8")


def test_a_report_shows_the_explanation_beside_the_log_unless_it_explains_another_log(tmp_path: Path) -> None:
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


def test_faults_that_each_suffice_are_named_together(tmp_path: Path) -> None:
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
