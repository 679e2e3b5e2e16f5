from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sweeping import SCENARIO, tiny

from symaware_cli.language.problem import ScenarioError
from symaware_cli.studies.request import SweepRequest, alternatives, varied
from symaware_cli.studies.sweep_plan import SweepPlan, seed_of, seeds_of
from symaware_cli.studies.sweep_source import read_sweep, written_again
from symaware_cli.world import expanded


def planned(scenario: Path, **options: object) -> SweepPlan:
    return read_sweep(scenario, SweepRequest(**options)).plan  # type: ignore[arg-type]


def test_every_combination_is_a_cell_and_the_last_parameter_varies_fastest(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    plan = planned(scenario, over=["agents.robot.count=1,2", "run.duration=1..2 by 0.5"])
    assert [list(cell.parameters.values()) for cell in plan.cells] == [
        [count, duration] for count in (1, 2) for duration in (1.0, 1.5, 2.0)
    ]


def test_lists_varied_together_form_one_axis(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    sweep = scenario.with_name("sweep.yaml")
    sweep.write_text(
        "symaware-sweep: 1\nscenario: tiny.yaml\nover: {agents.robot.count: [1, 2]}\n"
        "together:\n- {run.duration: [1, 2], run.pace: [10, 20]}\n"
    )
    cells = read_sweep(sweep).plan.cells
    assert [tuple(cell.parameters.values()) for cell in cells] == [(1, 1, 10), (1, 2, 20), (2, 1, 10), (2, 2, 20)]


def test_a_range_has_rounded_values() -> None:
    assert expanded("0..1 by 0.1") == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    assert expanded("4..1 by -1") == [4, 3, 2, 1]
    with pytest.raises(ValueError, match="never gets"):
        expanded("1..2 by -1")


def test_adding_runs_changes_neither_numbers_nor_seeds_of_existing_runs(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    few, many = (planned(scenario, over=["agents.robot.count=1,2"], entries={"runs": runs}) for runs in (3, 9))
    assert [few.seed(index) for index in range(few.count)] == [many.seed(index) for index in range(few.count)]
    assert [few.cell(index).parameters for index in range(6)] == [many.cell(index).parameters for index in range(6)]


def test_seeds_differ_between_runs_and_between_sweeps(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    plans = [planned(scenario, entries={"runs": 1000, "seed": seed}) for seed in (0, 1)]
    seeds = [plan.seed(index) for plan in plans for index in range(1000)]
    assert len({*seeds}) == 2000
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_only_paired_variants_share_the_seed_of_a_replicate(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    variants = {"variants.slow": {"run.duration": 2}, "variants.fast": {"run.duration": 1}}
    plan = planned(scenario, over=["agents.robot.count=1,2"], entries={**variants, "runs": 2, "paired": True})
    seeds = [plan.seed(index) for index in range(plan.count)]
    assert seeds[::2] == seeds[1::2]
    assert len({*seeds}) == 4
    apart = planned(scenario, entries={**variants, "runs": 2})
    assert len({apart.seed(index) for index in range(4)}) == 4


def test_a_document_written_to_a_file_gives_the_same_plan(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    source = read_sweep(
        scenario,
        SweepRequest(
            over=["run.duration=1..2 by 0.5"],
            entries={"variants.few": {"agents.robot.count": 1}, "keep": "worst:3"},
        ),
    )
    again = scenario.with_name("again.yaml")
    again.write_bytes(written_again(source.plan.document, scenario.name))
    assert read_sweep(again).plan.cells == source.plan.cells


def test_an_option_replaces_the_value_of_the_file_at_its_path(tmp_path: Path) -> None:
    tiny(tmp_path)
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(
        "symaware-sweep: 1\nscenario: tiny.yaml\nruns: 3\n"
        "set: {run.duration: 1, specifications: {a: {formula: x > 0}}}\n"
        "over: {agents.robot.count: {choice: [1, 2]}}\nmetrics: {low: min(lowest_separation)}\n"
    )
    changes = {"specifications": {"b": {"formula": "x > 1"}}, "run.duration": None}
    entries = ["metrics.high=max(highest_risk)", "runs=4", "bounds.satisfied.b=[0, 1]"]
    document = read_sweep(
        sweep, SweepRequest({"agents.robot.count": {"uniform": (1, 3)}}, changes, entries)
    ).plan.document
    # Null is a value for the scenario, whose entry it removes.
    assert document.set == changes
    assert document.drawn["agents.robot.count"].uniform == (1.0, 3.0)
    assert document.metrics == {"low": "min(lowest_separation)", "high": "max(highest_risk)"}
    assert (document.runs, document.bounds) == (4, {"satisfied.b": (0.0, 1.0)})


def test_values_from_python_and_from_options_give_the_same_plan(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    text = "a; b = c, d"
    asked = SweepRequest(
        {"run.duration": np.array([0.1, 0.30000000000000004]), "agents.robot.count": "1..2"},
        {"name": text},
        {"variants.one": {"description": text}, "runs": np.int64(2)},
    )
    typed = SweepRequest(
        ["run.duration=0.1,0.30000000000000004", "agents.robot.count=1..2"],
        [f"name={text}"],
        [f"variants.one={{description: '{text}'}}", "runs=2"],
    )
    assert repr(read_sweep(scenario, asked).plan) == repr(read_sweep(scenario, typed).plan)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a=1,x,null", [1, "x", None]),
        ("a=no", ["no"]),
        ("a=[3, 1]", [[3, 1]]),
        ("a=[3, 1],[0]", [[3, 1], [0]]),
        ("a=1..2 by 0.5", [1.0, 1.5, 2.0]),
    ],
)
def test_each_value_of_a_varied_parameter_gives_an_assignment(text: str, values: list[object]) -> None:
    found = alternatives(varied([text])[0])
    assert [each.value.plain() for each in found] == values
    assert {each.path for each in found} == {("a",)}


@pytest.mark.parametrize(
    ("text", "column", "said"),
    [
        ("a", 1, "there is no `=`"),
        ("a=", 2, "no list of values"),
        ("a={uniform: [0, 1]}", 3, "no list of values"),
        ("a=2..1", 3, "never gets from 2 to 1"),
        ("a=[1", 2, "is never closed"),
    ],
)
def test_a_varied_parameter_without_values_is_located(text: str, column: int, said: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        alternatives(varied([text])[0])
    assert f"--over {text}:1:{column}: " in str(caught.value)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("content", "where", "said"),
    [
        ("over: {a.b: []}", "3:13", "a list of at least 1"),
        ("over: {a.b: 1..0}", "3:13", "never gets from 1 to 0"),
        ("ovr: {a.b: [1]}", "3:1", "did you mean `over`?"),
        ("runs: 0", "3:7", "of at least 1"),
        ("keep: worst", "3:7", "worst:5"),
        ("paired: true", "3:1", "at least two `variants`"),
        ("over: {a.b: [1]}\ntogether: [{a.b: [1]}]", "4:13", "varies twice"),
        ("together: [{a.b: [1, 2], c.d: [1]}]", "3:31", "`c.d` has 1 values, and `a.b` has 2"),
        ("over: {seed: [1, 2]}", "3:8", "derived from the sweep's `seed`"),
        ("over: {a: '0..99999', b: '0..99999'}", "3:1", "at most 100,000 combinations"),
    ],
)
def test_problems_in_a_sweep_file_are_located(tmp_path: Path, content: str, where: str, said: str) -> None:
    (tmp_path / "tiny.yaml").write_text(SCENARIO)
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(f"symaware-sweep: 1\nscenario: tiny.yaml\n{content}\n")
    with pytest.raises(ScenarioError) as caught:
        read_sweep(sweep)
    assert f"sweep.yaml:{where}:" in str(caught.value)
    assert said in str(caught.value)


def test_many_seeds_are_those_of_single_runs() -> None:
    random = np.random.default_rng(0)
    roots = [0, 1, 2**32, 2**63 - 1, 2**100 + 3, *random.integers(0, 2**63, 30).tolist()]
    keys = [0, 1, 2**32 - 1, 5, 7, *random.integers(0, 1000, 30).tolist()]
    assert seeds_of(roots, keys) == [seed_of(*each) for each in zip(roots, keys, strict=True)]
    assert seeds_of(roots[:2], [2**40, 3]) == [seed_of(0, 2**40), seed_of(1, 3)]
