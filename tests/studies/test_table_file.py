"""The table of a sweep is read as written, or built from the journal if missing."""

import subprocess
import sys
from pathlib import Path

from sweeping import symaware, tiny

from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.sweep_reading import read_rows

_READ = """\
import sys
from symaware_cli.studies.sweep_reading import read_rows
table, planned = read_rows(sys.argv[1], 'robustness.near < 0.1 and state == "done"', "-robustness.near", 3)
assert (table.num_rows <= 3, planned) == (True, 6), (table.num_rows, planned)
heavy = {"symaware_cli.core", "symaware_cli.language.build", "pydantic", "numpy.ma", "pandas"} & sys.modules.keys()
assert not heavy, heavy
"""


def swept(folder: Path) -> Path:
    options = ["--over", "agents.robot.count=1,2", "--runs", 3, "-j", 0, "-q"]
    symaware("sweep", tiny(folder), "-o", folder / "swept", *options)
    return folder / "swept"


def test_the_table_read_from_the_journal_equals_the_written_one(tmp_path: Path) -> None:
    folder = swept(tmp_path)
    written = read_rows(folder)
    (folder / "runs.parquet").unlink()
    found = read_rows(folder)
    assert found == written
    assert found[0].schema.metadata == written[0].schema.metadata
    assert found[1] == 6


def test_reading_a_written_table_does_not_import_the_simulation(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", _READ, str(swept(tmp_path))], check=True)


def test_added_runs_count_as_planned_immediately(tmp_path: Path) -> None:
    folder = swept(tmp_path)
    SweepFolder.opened(folder).add_runs(2)
    table, planned = read_rows(folder)
    assert (table.num_rows, planned) == (6, 10)
