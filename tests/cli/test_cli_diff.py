"""``symaware diff`` as a user sees it."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from checkout import CHECKOUT
from typer.testing import CliRunner

from symaware_cli import sweep
from symaware_cli.cli.application import application
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

HEAD_ON = CHECKOUT / "scenarios" / "head-on.yaml"


def diff(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(application, ["diff", *map(str, arguments)], catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    execute(build(HEAD_ON, ["run.duration=2"]), folder / "one.mcap")
    execute(build(HEAD_ON, ["run.duration=2"]), folder / "same.mcap")
    slower = ["run.duration=2", "agents.robot.components.steer.with.speed=1.1"]
    execute(build(HEAD_ON, slower), folder / "slower.mcap")
    return folder


def test_equal_logs_have_exit_status_0(logs: Path) -> None:
    status, out, _ = diff(logs / "one.mcap", logs / "same.mcap")
    assert (status, out) == (0, f"{logs / 'one.mcap'} and {logs / 'same.mcap'}: equal\n")


def test_changes_are_reported_with_their_time(logs: Path) -> None:
    status, out, _ = diff(logs / "one.mcap", logs / "slower.mcap")
    assert status == 1
    assert "  scenario     agents.robot.components.steer.with.speed: 1.2 and 1.1 (" in out
    assert "\n  from here on at 0 s on /agents/robot/" in out
    assert "\n  /world/robot/state " in out
    said = json.loads(diff(logs / "one.mcap", logs / "slower.mcap", "--json")[1])
    assert [each["path"] for each in said["scenario"]] == ["agents.robot.components.steer.with.speed"]
    world = next(each for each in said["channels"] if each["topic"] == "/world/robot/state")
    assert world["first"]["time"] == 50_000_000
    assert world["agents"] == ["robot.0", "robot.1", "robot.2", "robot.3"]


def test_a_figure_of_both_is_drawn_on_request(logs: Path, tmp_path: Path) -> None:
    assert diff(logs / "one.mcap", logs / "slower.mcap", "--plot", tmp_path / "apart.png")[0] == 1
    assert (tmp_path / "apart.png").read_bytes().startswith(b"\x89PNG")
    status, _, said = diff(HEAD_ON, logs / "one.mcap", "--plot", tmp_path / "none.png")
    assert (status, said) == (2, "symaware: --plot goes with two logs, or with two sweeps\n")
    assert diff(logs / "one.mcap", logs / "slower.mcap", "--plot", tmp_path / "apart.docx")[0] == 2


def test_scenarios_are_compared_with_their_places(logs: Path, tmp_path: Path) -> None:
    text = HEAD_ON.read_text()
    (tmp_path / "other.yaml").write_text(text.replace("seed: 7", "seed: 8"))
    status, out, _ = diff(HEAD_ON, tmp_path / "other.yaml")
    assert status == 1
    line = next(number for number, each in enumerate(text.splitlines(), 1) if each.startswith("seed"))
    assert f"  scenario     seed: 7 and 8 ({HEAD_ON}:{line}, {tmp_path / 'other.yaml'}:{line})\n" in out
    assert diff(HEAD_ON, HEAD_ON)[0] == 0


def test_values_of_scenarios_are_shown_as_yaml_and_shortened(tmp_path: Path) -> None:
    rooms = ", ".join(f"room-{number}: {{box: [0, 1, 0, 2]}}" for number in range(9))
    (tmp_path / "other.yaml").write_text(f"{HEAD_ON.read_text()}\nregions: {{{rooms}}}\n")
    _, out, _ = diff(HEAD_ON, tmp_path / "other.yaml")
    assert "regions: nothing and {room-0: {box: [0" in out
    assert " ... " in out
    assert "'" not in out


def test_folders_and_other_files_than_logs_are_wrong_input(logs: Path, tmp_path: Path) -> None:
    assert diff(tmp_path, logs / "one.mcap")[0] == 2
    (tmp_path / "no.mcap").write_bytes(b"nothing")
    assert diff(tmp_path / "no.mcap", logs / "one.mcap")[0] == 2


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweeps")
    apart = {"each": "robot", "formula": "always nearest > 2.5"}
    common: dict[str, Any] = {"run.duration": 3.0, "specifications.apart": apart}
    for name, speed, seed in (("one", 1.2, 3), ("same", 1.2, 3), ("slower", 1.0, 3), ("other", 1.2, 4)):
        changes = {**common, "agents.robot.components.steer.with.speed": speed}
        sweep(HEAD_ON, folder / name, runs=4, seed=seed, changes=changes)
    return folder


def test_equal_sweeps_have_exit_status_0(sweeps: Path) -> None:
    status, out, _ = diff(sweeps / "one", sweeps / "same")
    assert status == 0
    assert "4 and 4; 4 in both, with the same seeds" in out


def test_metrics_of_two_sweeps_stand_side_by_side(sweeps: Path) -> None:
    status, out, _ = diff(sweeps / "one", sweeps / "slower")
    assert status == 1
    assert "scenario     agents.robot.components.steer.with.speed: 1.2 and 1.0" in out
    said = json.loads(diff(sweeps / "one", sweeps / "slower", "--json")[1])
    columns = {each["name"]: each for each in said["columns"]}
    assert columns["satisfied.apart"]["means"] == [0.0, 1.0]
    assert columns["path_length"]["difference"] == pytest.approx(-4 * 3 * 0.2)
    assert columns["path_length"]["differing"] == 4
    assert said["is_paired"]
    assert said["first"] == 0


def test_means_and_differences_are_those_of_the_runs_that_both_sweeps_have(sweeps: Path, tmp_path: Path) -> None:
    shutil.copytree(sweeps / "slower", tmp_path / "shorter")
    table = pq.read_table(tmp_path / "shorter" / "runs.parquet")
    pq.write_table(table.slice(0, 2), tmp_path / "shorter" / "runs.parquet")
    said = json.loads(diff(sweeps / "one", tmp_path / "shorter", "--json")[1])
    columns = {each["name"]: each for each in said["columns"]}
    for name, column in columns.items():
        one, other = column["means"]
        assert column["difference"] == pytest.approx(other - one), name
    both = pq.read_table(sweeps / "one" / "runs.parquet")["path_length"].to_pylist()[:2]
    assert columns["path_length"]["means"][0] == pytest.approx(sum(both) / 2)


def test_a_figure_of_two_sweeps_shows_their_runs_in_pairs(sweeps: Path, tmp_path: Path) -> None:
    assert diff(sweeps / "one", sweeps / "slower", "--plot", tmp_path / "pairs.svg")[0] == 1
    drawn = (tmp_path / "pairs.svg").read_text()
    diff(sweeps / "one", sweeps / "slower", "--plot", tmp_path / "again.svg")
    assert (tmp_path / "again.svg").read_text() == drawn
    assert "mean difference -2.4" in drawn  # the path length: four robots, three seconds, 0.2 m/s less
    assert "slower only" in drawn  # satisfied.apart
    status, _, said = diff(sweeps / "one", sweeps / "same", "--plot", tmp_path / "none.svg")
    assert status == 2
    assert "nothing to draw" in said
    assert diff(sweeps / "one", HEAD_ON, "--plot", tmp_path / "none.svg")[0] == 2


def test_sweeps_with_other_seeds_are_not_paired(sweeps: Path) -> None:
    said = json.loads(diff(sweeps / "one", sweeps / "other", "--json")[1])
    assert not said["equal"]
    assert not said["is_paired"]
    assert [each["path"] for each in said["plan"]] == ["seed"]


def test_a_changed_number_in_a_table_is_found(sweeps: Path, tmp_path: Path) -> None:
    shutil.copytree(sweeps / "one", tmp_path / "forged")
    table = pq.read_table(tmp_path / "forged" / "runs.parquet")
    place = table.column_names.index("closest")
    values = table["closest"].to_pylist()
    values[2] += 1e-12
    pq.write_table(table.set_column(place, table.schema.field("closest"), [values]), tmp_path / "forged/runs.parquet")
    said = json.loads(diff(sweeps / "one", tmp_path / "forged", "--json")[1])
    assert (said["differing"], said["first"]) == (1, 2)
    assert [each["name"] for each in said["columns"]] == ["closest"]


def test_a_folder_is_compared_with_another_sweep_only(sweeps: Path, tmp_path: Path) -> None:
    assert diff(sweeps / "one", HEAD_ON)[0] == 2
    assert diff(sweeps / "one", tmp_path)[0] == 2
    shutil.copytree(sweeps / "one", tmp_path / "unfinished")
    (tmp_path / "unfinished" / "runs.parquet").unlink()
    status, _, err = diff(sweeps / "one", tmp_path / "unfinished")
    assert status == 2
    assert "has no table yet" in err


@pytest.mark.parametrize("verb", [["diff", "swept", "swept"], ["inspect", "swept"]])
def test_without_pyarrow_the_error_has_the_command_that_installs_it(verb: list[str], tmp_path: Path) -> None:
    sweep(HEAD_ON, tmp_path / "swept", runs=2, changes={"run.duration": 0.5}, jobs=0)
    code = "import sys; sys.modules['pyarrow'] = None; from symaware_cli.cli import main; main()"
    line = [sys.executable, "-c", code, *verb]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    told = "symaware: a sweep needs the module `pyarrow`, which is not installed: pip install 'symaware-cli[sweep]'\n"
    assert (done.returncode, done.stderr) == (2, told)
