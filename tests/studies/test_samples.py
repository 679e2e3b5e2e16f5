"""Drawn values depend on the sweep's seed and the sample's number, not on the number of workers or runs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeping import rows, symaware, table_digest, tiny

import symaware_cli
from symaware_cli.language.problem import Problem, ScenarioError
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.picture.finished_runs import finished_runs
from symaware_cli.studies.sweep_document import SweepDocument
from symaware_cli.studies.sweep_plan import Samples, SweepPlan
from symaware_cli.studies.sweep_source import read_sweep, written_again

SPEED, DURATION = "agents.robot.model.with.max_speed", "run.duration"
DRAWN: dict[str, dict[str, Any]] = {SPEED: {"uniform": [0.5, 2.0]}, DURATION: {"choice": [0.5, 1.0], "weights": [3, 1]}}

numbers = st.floats(-1e6, 1e6, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-6)
ordered = st.tuples(numbers, numbers).map(sorted)
distributions = st.one_of(
    st.fixed_dictionaries({"uniform": ordered}),
    st.fixed_dictionaries({"normal": st.tuples(numbers, numbers.map(abs)).map(list)}),
    st.fixed_dictionaries({"loguniform": st.tuples(numbers.map(abs), numbers.map(abs)).map(sorted)}).filter(
        lambda each: each["loguniform"][0] > 0
    ),
    st.fixed_dictionaries({"choice": st.lists(st.one_of(numbers, st.booleans(), st.text("ab")), min_size=1)}),
)


def document(**said: Any) -> SweepDocument:
    content = {"symaware-sweep": 1, "scenario": "tiny.yaml", **said}
    return SweepDocument.model_validate_json(json.dumps(content), strict=True)


def sweep_file(folder: Path, **said: Any) -> Path:
    tiny(folder)
    path = folder / "sweep.yaml"
    path.write_text(json.dumps({"symaware-sweep": 1, "scenario": "tiny.yaml", "over": DRAWN, **said}))
    return path


@given(over=st.dictionaries(st.text("abc.", min_size=1, max_size=5), distributions, min_size=1, max_size=3))
def test_a_rewritten_sweep_draws_the_same_values(over: dict[str, Any]) -> None:
    said = document(over=over, runs=5, design="sobol")
    again = SweepDocument.model_validate_json(json.dumps(json.loads(_json(written_again(said, "tiny.yaml")))))
    assert [Samples(said).of(number) for number in range(5)] == [Samples(again).of(number) for number in range(5)]


def _json(text: bytes) -> str:
    from symaware_cli.language.source import decode
    from symaware_cli.language.yaml_source import parse_yaml

    source = decode("sweep.yaml", text)
    parse_yaml(source)
    return json.dumps(source.data)


@given(
    seed=st.integers(0, 2**63 - 1),
    runs=st.integers(1, 70),
    more=st.integers(0, 2000),
    design=st.sampled_from(["random", "sobol"]),
)
def test_adding_runs_keeps_the_drawn_values_of_existing_ones(seed: int, runs: int, more: int, design: str) -> None:
    few, many = (document(over=DRAWN, seed=seed, runs=count, design=design) for count in (runs, runs + more))
    assert [Samples(few).of(k) for k in range(runs)] == [Samples(many).of(k) for k in range(runs)]


@given(seed=st.integers(0, 2**63 - 1), runs=st.integers(1, 200))
def test_one_run_draws_from_each_part_of_a_latin_hypercube(seed: int, runs: int) -> None:
    samples = Samples(document(over=DRAWN, seed=seed, runs=runs, design="latin-hypercube"))
    speeds = np.array([samples.of(number)[SPEED] for number in range(runs)])
    parts = np.floor((speeds - 0.5) / 1.5 * runs).astype(int)
    assert sorted(parts.tolist()) == list(range(runs))


@given(order=st.lists(st.integers(0, 2999), max_size=5), design=st.sampled_from(["random", "latin-hypercube", "sobol"]))
def test_a_sample_depends_on_its_number_and_not_on_earlier_draws(order: list[int], design: str) -> None:
    said = document(over=DRAWN, runs=3000, design=design)
    mixed = Samples(said)
    for number in order:
        assert mixed.of(number) == Samples(said).of(number)


words = st.sampled_from(["uniform", "normal", "loguniform", "choice", "weights", "unifrom", "1..3", "3..1 by 1", ""])
anything = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(-3, 3), st.floats(-2, 2), words),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(words, inner, max_size=2)),
    max_leaves=6,
)


@given(over=st.dictionaries(st.text("abc.", min_size=1, max_size=5), anything, max_size=2), design=words)
def test_any_file_gives_a_plan_or_a_located_problem(
    over: dict[str, Any], design: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.getbasetemp() / "anything.yaml"
    said = {"symaware-sweep": 1, "scenario": "tiny.yaml", "over": over, "runs": 3}
    file.write_text(json.dumps(said if design in ("", "uniform") else {**said, "design": design}))
    problems: Sequence[Problem] = ()
    try:
        plan = read_sweep(file).plan
    except ScenarioError as error:
        problems = error.problems
    assert all(problem.span is not None and problem.span.line == 1 for problem in problems)
    if not problems:
        for index in range(min(plan.count, 9)):
            assert {*plan.parameters(index)} == {*over}
        assert len(list(plan.landmark_changes())) >= len(plan.document.drawn)


def test_all_combinations_and_variants_draw_the_same_sample_in_the_same_replicate() -> None:
    plan = SweepPlan(
        document(
            over={"agents.robot.count": [1, 2], **DRAWN},
            variants={"slow": {"a.b": 1}, "fast": {"a.b": 2}},
            runs=3,
            design="sobol",
        )
    )
    assert (len(plan.cells), plan.count) == (4, 12)
    assert plan.paths == ("agents.robot.count", SPEED, DURATION)
    for index in range(plan.count):
        assert plan.parameters(index) == {
            **plan.cell(index).parameters,
            **plan.samples.of(plan.replicate(index)),
        }
        # The changes of a variant take precedence over drawn values.
        assert plan.changes(index)[-1].target == "a.b"
    assert plan.parameters(0)[SPEED] == plan.parameters(3)[SPEED] != plan.parameters(4)[SPEED]


def test_drawn_values_are_columns_independent_of_the_number_of_workers(tmp_path: Path) -> None:
    file = sweep_file(tmp_path, runs=6, seed=3, design="latin-hypercube")
    for jobs in (0, 2):
        symaware("sweep", file, "-o", tmp_path / f"{jobs}", "--jobs", jobs)
    assert table_digest(tmp_path / "0") == table_digest(tmp_path / "2")
    found = rows(tmp_path / "0")
    assert len({row[SPEED] for row in found}) == 6
    assert {row[DURATION] for row in found} == {0.5, 1.0}
    for row in found:
        assert row["time"] == pytest.approx(row[DURATION])
        alone = symaware_cli.load(
            tmp_path / "tiny.yaml", {SPEED: row[SPEED], DURATION: row[DURATION]}, seed=row["seed"]
        )
        assert alone.run(record=False).summary.specifications[0].robustness == row["robustness.near"]


def test_a_run_with_drawn_values_can_be_repeated_by_its_number(tmp_path: Path) -> None:
    file, out = sweep_file(tmp_path, runs=3), tmp_path / "out"
    symaware("sweep", file, "-o", out, "-j", 0, "--with", "keep=all")
    row = rows(out)[2]
    status = 3 * (row["verdict.near"] == "violated")
    said = json.loads(symaware("run", out, "--index", 2, "-o", tmp_path / "2.mcap", "--json", status=status))
    assert said["minimum_separation"]["value"] == row["closest"]
    # The kept logs belong to the same runs, otherwise the sweep would have ended with an error.
    assert len(list((out / "logs").iterdir())) == 3


def test_runs_can_be_added_to_a_sobol_sequence_but_not_to_a_latin_hypercube(tmp_path: Path) -> None:
    file, out = sweep_file(tmp_path, runs=3, design="sobol"), tmp_path / "out"
    symaware("sweep", file, "-o", out, "-j", 0)
    before = rows(out)
    symaware("resume", out, "--add-runs", 2, "-j", 0)
    assert rows(out)[:3] == before
    symaware("sweep", file, "-o", tmp_path / "all", "--runs", 5, "-j", 0)
    assert table_digest(out) == table_digest(tmp_path / "all")
    symaware("sweep", file, "-o", tmp_path / "lhs", "--with", "design=latin-hypercube", "-j", 0)
    said = symaware("resume", tmp_path / "lhs", "--add-runs", 2, status=2)
    assert "drawn for all of its runs at once" in said
    assert "design: sobol" in said


def test_shares_of_dependent_runs_have_no_intervals(tmp_path: Path) -> None:
    file, out = sweep_file(tmp_path, runs=4, design="sobol"), tmp_path / "out"
    symaware("sweep", file, "-o", out, "-j", 0)
    (share,) = json.loads(symaware("shares", out, "--json"))
    assert (share["count"], share["lower"], share["upper"]) == (4, "nan", "nan")
    assert "the runs depend on each other" in symaware("shares", out)


def test_variants_with_dependent_runs_are_compared_without_tests(tmp_path: Path) -> None:
    variants = {"slow": {"agents.robot.count": 1}, "fast": {"agents.robot.count": 2}}
    for design in ("random", "sobol"):
        file = sweep_file(tmp_path, runs=4, design=design, variants=variants, paired=True)
        symaware("sweep", file, "-o", tmp_path / design, "-j", 0)
    (random,) = json.loads(symaware("compare", tmp_path / "random", "path_length", "--json"))
    assert random["mean"]["lower"] < random["mean"]["value"] < random["mean"]["upper"]
    (sobol,) = json.loads(symaware("compare", tmp_path / "sobol", "path_length", "--json"))
    assert (sobol["mean"]["lower"], sobol["sign_test"], sobol["greater"]) == ("nan", "nan", 4)
    said = symaware("compare", tmp_path / "sobol", "path_length")
    assert "sign test" not in said
    assert "the runs depend on each other" in said


def test_command_line_and_python_draw_the_same_values_as_a_file(tmp_path: Path) -> None:
    file = sweep_file(tmp_path, runs=3, seed=5, design="sobol")
    table = symaware_cli.sweep(file)
    assert table.equals(symaware_cli.sweep(tmp_path / "tiny.yaml", over=DRAWN, design="sobol", runs=3, seed=5))
    over = [f"--over={path}={json.dumps(each)}" for path, each in DRAWN.items()]
    options = ["--with", "design=sobol", "--runs", 3, "--seed", 5, "-j", 0]
    symaware("sweep", tmp_path / "tiny.yaml", "-o", tmp_path / "out", *over, *options)
    assert rows(tmp_path / "out") == table.to_pylist()


def test_a_picture_shows_runs_over_drawn_values(tmp_path: Path) -> None:
    file, out = sweep_file(tmp_path, runs=5), tmp_path / "out"
    symaware("sweep", file, "-o", out, "-j", 0)
    (speed, duration) = finished_runs(SweepFolder.opened(out)).drawn
    assert speed.values.tolist() == [row[SPEED] for row in rows(out)]
    assert duration.options is not None
    assert [duration.options[int(place)] for place in duration.values] == [row[DURATION] for row in rows(out)]
    facts = json.loads(symaware("plot", out, "-o", tmp_path / "a.png", "--show", "path_length", "--json"))
    assert [panel["kind"] for panel in facts["panels"]] == ["scatter", "scatter"]
