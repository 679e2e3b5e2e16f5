from __future__ import annotations

from pathlib import Path

import pytest
from sweeping import SCENARIO, tiny

from symaware_cli.language.problem import ScenarioError
from symaware_cli.studies.request import SweepRequest
from symaware_cli.studies.sweep_plan import SweepPlan
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


def test_lists_that_vary_together_are_one_axis(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    sweep = scenario.with_name("sweep.yaml")
    sweep.write_text(
        "symaware-sweep: 1\nscenario: tiny.yaml\nover: {agents.robot.count: [1, 2]}\n"
        "together:\n- {run.duration: [1, 2], run.pace: [10, 20]}\n"
    )
    cells = read_sweep(sweep).plan.cells
    assert [tuple(cell.parameters.values()) for cell in cells] == [(1, 1, 10), (1, 2, 20), (2, 1, 10), (2, 2, 20)]


def test_a_range_has_the_values_that_a_person_would_write() -> None:
    assert expanded("0..1 by 0.1") == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    assert expanded("4..1 by -1") == [4, 3, 2, 1]
    with pytest.raises(ValueError, match="never gets"):
        expanded("1..2 by -1")


def test_more_runs_change_neither_the_numbers_nor_the_seeds_of_those_before(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    few, many = (planned(scenario, over=["agents.robot.count=1,2"], options={"runs": runs}) for runs in ("3", "9"))
    assert [few.seed(index) for index in range(few.count)] == [many.seed(index) for index in range(few.count)]
    assert [few.cell(index).parameters for index in range(6)] == [many.cell(index).parameters for index in range(6)]


def test_seeds_of_runs_and_of_sweeps_differ(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    plans = [planned(scenario, options={"runs": "1000", "seed": seed}) for seed in ("0", "1")]
    seeds = [plan.seed(index) for plan in plans for index in range(1000)]
    assert len({*seeds}) == 2000
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_paired_variants_share_the_seed_of_their_replicate_and_others_do_not(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    variants = [("slow", "run.duration=2"), ("fast", "run.duration=1")]
    plan = planned(
        scenario, over=["agents.robot.count=1,2"], variants=variants, options={"runs": "2", "paired": "true"}
    )
    seeds = [plan.seed(index) for index in range(plan.count)]
    assert seeds[::2] == seeds[1::2]
    assert len({*seeds}) == 4
    apart = planned(scenario, variants=variants, options={"runs": "2"})
    assert len({apart.seed(index) for index in range(4)}) == 4


def test_a_document_that_is_written_again_is_the_same_plan(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    source = read_sweep(
        scenario,
        SweepRequest(
            over=["run.duration=1..2 by 0.5"], variants=[("few", "agents.robot.count=1")], options={"keep": "worst:3"}
        ),
    )
    again = scenario.with_name("again.yaml")
    again.write_bytes(written_again(source.plan.document, scenario.name))
    assert read_sweep(again).plan.cells == source.plan.cells


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
def test_what_is_wrong_in_a_file_of_a_sweep_is_located(tmp_path: Path, content: str, where: str, said: str) -> None:
    (tmp_path / "tiny.yaml").write_text(SCENARIO)
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(f"symaware-sweep: 1\nscenario: tiny.yaml\n{content}\n")
    with pytest.raises(ScenarioError) as caught:
        read_sweep(sweep)
    assert f"sweep.yaml:{where}:" in str(caught.value)
    assert said in str(caught.value)
