"""NumPy and BLAS use the same kernels on every processor of level x86-64-v3, which the log states."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from simulating import Command

from symaware_cli import open_log, processor

needs_level = pytest.mark.skipif(
    processor.level() not in ("x86-64-v3", "x86-64-v4"), reason="nothing is promised of this processor"
)

TOLD = """
import json, os, symaware_cli
from symaware_cli import processor
import numpy, scipy.linalg
print(json.dumps([processor.numpy_kernels(), [[each.kernel, each.threads] for each in processor.blas()]]))
"""


def clean(**variables: str) -> dict[str, str]:
    """The environment of a shell without settings of kernels."""
    return {name: value for name, value in os.environ.items() if name not in processor.VARIABLES} | variables


def python(code: str, **variables: str) -> str:
    done = subprocess.run(
        [sys.executable, "-P", "-W", "error", "-c", code], env=clean(**variables), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@needs_level
def test_numpy_leaves_avx_512_alone_and_each_openblas_takes_the_same_kernels_and_one_thread() -> None:
    kernels, blas = json.loads(python(TOLD))
    assert kernels
    assert not [name for name in kernels if name.startswith("AVX512") or name == "X86_V4"]
    # NumPy's and SciPy's are two libraries.
    assert blas == [["Haswell", 1]] * 2


def test_no_setting_is_made_that_numpy_would_warn_of() -> None:
    # -W error makes an error of the warning.
    python("import symaware_cli, numpy")


@needs_level
def test_variables_that_are_set_already_are_kept() -> None:
    kernels, blas = json.loads(
        python(TOLD, NPY_DISABLE_CPU_FEATURES="", OPENBLAS_CORETYPE="Nehalem", OMP_NUM_THREADS="2")
    )
    untouched = json.loads(python(TOLD.replace("symaware_cli\nfrom", "sys, numpy\nfrom"), OPENBLAS_CORETYPE="Nehalem"))
    assert kernels == untouched[0]
    assert blas == [["Nehalem", min(2, len(os.sched_getaffinity(0)))]] * 2


@needs_level
def test_a_run_and_its_log_report_that_variables_were_set_differently(process: Command, scenarios: Path) -> None:
    short = ("--set", "run.duration=0.1")
    done = process("run", scenarios / "hello.yaml", *short, "-o", "a.mcap", env=clean(OPENBLAS_CORETYPE="Nehalem"))
    assert done.returncode == 0
    assert "symaware: OpenBLAS uses its kernel Nehalem (set by the environment" in done.stderr
    told = json.loads(open_log("a.mcap").attachments["versions.json"])
    assert "Nehalem" in told["BLAS"]
    assert told["Pinned"].startswith("no: OpenBLAS uses its kernel Nehalem")
    assert "OpenBLAS uses its kernel Nehalem" in process("inspect", "a.mcap").stdout

    done = process("run", scenarios / "hello.yaml", *short, "-o", "b.mcap", env=clean())
    assert (done.returncode, done.stderr) == (0, "")
    told = json.loads(open_log("b.mcap").attachments["versions.json"])
    assert (told["Pinned"], "Haswell, 1 thread" in told["BLAS"]) == ("yes", True)


LATE = """
import os
os.environ["OPENBLAS_CORETYPE"] = "Nehalem"
import numpy
del os.environ["OPENBLAS_CORETYPE"]
before = dict(os.environ)
import symaware_cli
from symaware_cli import processor
"""


@needs_level
def test_where_numpy_came_first_nothing_is_changed_and_a_run_warns(scenarios: Path) -> None:
    code = f"""{LATE}
import warnings
from pathlib import Path
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
assert dict(os.environ) == before
built = build(Path({str(scenarios / "hello.yaml")!r}), ["run.duration=0.1"])
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    execute(built, None)
print([(each.category.__name__, str(each.message)) for each in caught])
"""
    said = python(code)
    assert said.startswith("[('ProcessorWarning', '")
    assert "OpenBLAS uses its kernel Nehalem" in said
    assert "NumPy was imported before symaware_cli" in said


@needs_level
def test_a_process_warns_once_however_many_runs_and_cells_there_are(scenarios: Path) -> None:
    code = f"""{LATE}
import warnings
import symaware_cli as sa
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for cell in range(3):
        scenario = sa.load({str(scenarios / "hello.yaml")!r}, ["run.duration=0.1"])
        exec(compile("scenario.run(record=False)", f"<cell {{cell}}>", "exec"))
    with scenario.start():
        pass
print(len(caught), caught[0].filename, str(caught[0].message).count(": "))
"""
    assert python(code).split("\n")[0] == "1 <cell 0> 1"


@needs_level
def test_a_process_for_workers_computes_as_the_one_that_starts_it_even_where_numpy_came_first() -> None:
    code = f"""{LATE}
import subprocess, sys
code = "import symaware_cli, numpy; from symaware_cli import processor; print(processor.in_force())"
print(processor.in_force(), flush=True)
subprocess.run([sys.executable, "-P", "-c", code], env=processor.environment(), check=True)
"""
    first, second = python(code).splitlines()
    assert "Nehalem" in first
    assert first == second


@needs_level
def test_workers_compute_with_the_same_kernels_as_the_run(process: Command, doubles: Path, tmp_path: Path) -> None:
    (tmp_path / "kernels.yaml").write_text(
        """
symaware: 1
name: kernels
run: {duration: 0.1}
environment: {use: kinematic}
agents:
  robot:
    model: {use: single-integrator}
    state: [0, 0]
    components:
      here: {use: doubles.kernels}
      there: {use: doubles.kernels, run_in: process}
"""
    )
    for variables in ({}, {"OPENBLAS_CORETYPE": "Nehalem"}):
        done = process("run", "kernels.yaml", "-o", "a.mcap", env=clean(**variables))
        assert done.returncode == 0, done.stderr
        told = {event.text for event in open_log("a.mcap").events() if event.name == "kernels"}
        assert len(told) == 1
        assert (variables.get("OPENBLAS_CORETYPE", "Haswell")) in told.pop()


def test_the_program_starts_without_numpy_and_pins_all_the_same(process: Command) -> None:
    assert process("--version", env=clean()).returncode == 0
    assert "numpy" not in python("import sys, symaware_cli.cli; print(*sys.modules)").split()


@needs_level
def test_a_blas_that_was_built_for_one_processor_causes_no_warning_and_no_variables_for_workers() -> None:
    code = """
import symaware_cli, numpy
from symaware_cli import processor
from casadi import SX, nlpsol
x = SX.sym("x")
nlpsol("quiet", "ipopt", {"x": x, "f": x**2}, {"ipopt.sb": "yes", "ipopt.print_level": 0, "print_time": False})(x0=1)
assert {each.kernel for each in processor.blas()} == {"Haswell", "CORE2"}, processor.blas()
assert processor.shortfall() is None, processor.shortfall()
assert processor.environment()["OPENBLAS_CORETYPE"] == "Haswell"
"""
    pytest.importorskip("casadi")
    python(code)
