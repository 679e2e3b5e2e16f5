"""`symaware doctor`: the parts of the installation, whether they work, and how to repair those that do not."""

import json
import os
import subprocess
from pathlib import Path

import pytest
from simulating import COMMAND
from typer.testing import CliRunner

from symaware_cli.cli.application import application
from symaware_cli.cli.self_test import answer


def test_with_quick_it_lists_installed_parts_without_trying_them() -> None:
    done = CliRunner().invoke(application, ["doctor", "--quick", "--json"])
    found = json.loads(done.stdout)
    assert done.exit_code == 0
    assert found["works"] is True
    names = {each["name"]: each for each in found["found"]}
    assert names["symaware"]["status"] == "works"
    assert "OpenBLAS" in names["kernels"]["message"]
    assert {"extra viewer", "extra qp", "temporary files", "configuration"} <= names.keys()
    assert not {"world kinematic", "viewer"} & names.keys()
    assert all(each["remedy"] for each in names.values() if each["status"] == "missing")


@pytest.mark.parametrize(
    ("name", "argument"), [("world", "kinematic"), ("world", "pymunk"), ("highspy", ""), ("daqp", "")]
)
def test_installed_parts_work(name: str, argument: str) -> None:
    assert answer(name, argument)[0] == "works"


def test_a_broken_solver_is_reported_with_exit_status_3(tmp_path: Path) -> None:
    (tmp_path / "daqp.py").write_text("import os\n\nos.abort()\n")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    script = "import symaware_cli.cli.doctor as d; d._worlds = lambda: (); d.MODULES = {'daqp': d.MODULES['daqp']}; "
    script += "from symaware_cli.cli import main; import sys; sys.argv = ['symaware', 'doctor']; main()"
    done = subprocess.run(
        [COMMAND[0], "-P", "-c", script], env=environment, capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 3, done.stderr
    assert "BROKEN  daqp" in done.stdout
    assert "signal 6" in done.stdout
    assert "pip install --force-reinstall 'symaware-cli[qp]'" in done.stdout
    assert done.stdout.endswith("broken: daqp\n")
