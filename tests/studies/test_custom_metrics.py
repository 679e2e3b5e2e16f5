from __future__ import annotations

import os
from pathlib import Path

import pytest
from sweeping import rows, symaware, tiny

from symaware_cli import open_log

_PLUGIN = """\
from pydantic import Field
from symaware_cli import Metric, Parameters


class Lead(Metric):
    '''How far the first agent is ahead of a line at the end.'''

    unit = "m"
    version = 3

    class Parameters(Parameters):
        '''The line.'''

        line: float = Field(0.0, description="Where it is [m].")

    def begin(self):
        self.steps = 0

    def look(self, now):
        self.steps += 1

    def value(self):
        return self.environment.state(self.groups[0])[0, 0] - self.parameters.line


class Odd(Lead):
    kind = "integer"

    def value(self):
        return 0.5


class Faulty(Lead):
    def value(self):
        raise ZeroDivisionError("on purpose")
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = tmp_path / "site"
    about = site / "measures-1.0.dist-info"
    about.mkdir(parents=True)
    (site / "measures.py").write_text(_PLUGIN)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: measures\nVersion: 1.0\n")
    points = [f"measures.{name.lower()} = measures:{name}" for name in ("Lead", "Odd", "Faulty")]
    (about / "entry_points.txt").write_text("\n".join(["[symaware.metrics]", *points]))
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]))


def sweep(folder: Path, metrics: str, **options: int) -> Path:
    tiny(folder)
    path, out = folder / "sweep.yaml", folder / "out"
    path.write_text(f"symaware-sweep: 1\nscenario: tiny.yaml\nruns: 3\nmetrics: {metrics}\n")
    symaware("sweep", path, "-o", out, "--jobs", 0, **options)
    return out


def test_a_series_is_reduced_to_one_number(tmp_path: Path) -> None:
    out = sweep(
        tmp_path,
        '{far: "max(position.robot)", first: "initial(state[\'robot.0\'][0])", last: "final(state[\'robot.0\'][0])",'
        ' usual: "mean(min_separation)"}',
    )
    for row in rows(out):
        symaware("run", out, "--index", row["index"], "-o", tmp_path / "log.mcap", status=_status(row))
        states = open_log(tmp_path / "log.mcap").series("robot", "world").values
        assert row["far"] == states[:, :, :2].max()
        assert (row["first"], row["last"]) == (states[0, 0, 0], states[-1, 0, 0])
        apart = ((states[:, 0, :2] - states[:, 1, :2]) ** 2).sum(axis=1) ** 0.5
        assert row["usual"] == pytest.approx(apart.mean())


def _status(row: dict[str, object]) -> int:
    return 3 if row["verdict.near"] == "violated" else 0


@pytest.mark.usefixtures("plugin")
def test_a_metric_of_a_plugin_has_a_column_with_its_type_and_unit(tmp_path: Path) -> None:
    from pyarrow import parquet

    out = sweep(tmp_path, "{lead: {use: measures.lead, with: {line: 1.0}}, last: \"final(state['robot.0'][0])\"}")
    for row in rows(out):
        assert row["lead"] == row["last"] - 1.0
    field = parquet.read_schema(out / "runs.parquet").field("lead")
    assert field.metadata[b"unit"] == b"m"
    assert field.metadata[b"version"] == b"3"
    assert "measures.lead" in symaware("list", "metrics")


@pytest.mark.usefixtures("plugin")
@pytest.mark.parametrize(
    ("use", "said"),
    [("odd", "`0.5`, and was declared to be of the kind integer"), ("faulty", "ZeroDivisionError: on purpose")],
)
def test_a_failing_metric_gives_a_failed_row(tmp_path: Path, use: str, said: str) -> None:
    out = sweep(tmp_path, f"{{strange: {{use: measures.{use}}}}}", status=1)
    for row in rows(out):
        assert row["state"] == "failed"
        assert "strange" in row["error"]
        assert said in row["error"]


@pytest.mark.parametrize(
    ("metrics", "said"),
    [
        ("{far: max(positoin.robot)}", "sweep.yaml:4:20: there is no `positoin`"),
        ("{far: greatest(position.robot)}", "a series is reduced by final, initial, max, mean, min"),
        ("{far: {use: measures.led}}", "no metric called `measures.led` is installed"),
        ("{closest: max(time)}", "every table has a column `closest`"),
    ],
)
def test_an_invalid_metric_is_located_and_nothing_is_created(tmp_path: Path, metrics: str, said: str) -> None:
    tiny(tmp_path)
    path, out = tmp_path / "sweep.yaml", tmp_path / "out"
    path.write_text(f"symaware-sweep: 1\nscenario: tiny.yaml\nruns: 3\nmetrics: {metrics}\n")
    assert said in symaware("sweep", path, "-o", out, status=2)
    assert not out.exists()
