"""The worker of a cluster node, without a cluster: it receives blocks and returns rows and logs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import own_files
import pytest
import sweeping
from sweeping import symaware, tiny

from symaware_cli.plugin_files import remember
from symaware_cli.plugin_files.file_trust import HANDED_DOWN
from symaware_cli.studies import node_worker
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.identity import CodeIdentity
from symaware_cli.studies.node_worker import SweepSetup
from symaware_cli.studies.ray_cluster import files_of, own_code_of


@pytest.fixture
def setup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SweepSetup]:
    out = tmp_path / "out"
    symaware("sweep", tiny(tmp_path), "-o", out, "--runs", 3, "--jobs", 0)
    (tmp_path / "node").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "node"))
    yield SweepSetup(str(tmp_path), files_of(out), None, 1, CodeIdentity.of_this_process().to_json())
    node_worker.close()


def test_rows_equal_those_of_one_process_and_no_files_remain_on_the_node(setup: SweepSetup, tmp_path: Path) -> None:
    expected = list(SweepFolder.opened(tmp_path / "out").runner(1).rows([0, 1, 2]))
    found = [*node_worker.answer(setup, [0], False).rows, *node_worker.answer(setup, [1, 2], False).rows]
    assert [replace(row, wall_time=0.0) for row in found] == [replace(row, wall_time=0.0) for row in expected]
    assert not [*(tmp_path / "node").iterdir()]


def test_logs_are_returned_under_the_names_in_their_rows(setup: SweepSetup, tmp_path: Path) -> None:
    answered = node_worker.answer(setup, [0, 1], True)
    assert [row.log for row in answered.rows] == [*{row.log: None for row in answered.rows}]
    assert {row.log for row in answered.rows} == answered.logs.keys()
    folder = tmp_path / "logs"
    folder.mkdir()
    again = SweepFolder.opened(tmp_path / "out").runner(1).run(0, folder)
    assert again.log in answered.logs


def test_own_code_is_not_sent_and_comes_from_a_folder_that_the_node_trusts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "sender"))
    monkeypatch.setenv(HANDED_DOWN, "[]")
    scenario, out = own_files.written(tmp_path), tmp_path / "out"
    symaware("trust", tmp_path)
    symaware("sweep", scenario, "-o", out, "--runs", 2, "--jobs", 0)
    monkeypatch.setenv(HANDED_DOWN, "[]")  # the node is another machine
    files, code = files_of(out), CodeIdentity.of_this_process().to_json()
    assert not [name for name in files if name.endswith(".py")]
    setup = SweepSetup(str(tmp_path), files, None, 1, code, own_code_of(out))
    node = tmp_path / "node"
    (node / "deep").mkdir(parents=True)
    monkeypatch.setattr("tempfile.tempdir", str(node))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "receiver"))
    (node / "deep" / "mine.py").write_text(own_files.CONTROLLER)
    assert "mine.py of this sweep is not trusted on this node" in (node_worker.answer(setup, [0], False).trouble or "")
    remember(node)
    rows = node_worker.answer(setup, [0, 1], False).rows
    assert [row.state for row in rows] == ["done", "done"]
    assert [row.digest for row in rows] == [row["digest"] for row in sweeping.rows(out)]
    # Another file at the same place is not taken for it, though it is trusted.
    (node / "deep" / "mine.py").write_text(own_files.CONTROLLER + "# edited")
    remember(node)
    assert node_worker.answer(setup, [0], False).trouble
    node_worker.close()


def changed(code: Any, distribution: str, file: str, content: str | None) -> dict[str, Any]:
    files = {**code["files"][distribution], file: content}
    return {**code, "files": {**code["files"], distribution: {name: each for name, each in files.items() if each}}}


def test_different_code_is_rejected_naming_distribution_and_file(setup: SweepSetup) -> None:
    other = changed(setup.code, "numpy", "numpy/version.py", "0")
    other = changed(other, "symaware-cli", "symaware_cli/core/agent.py", None)
    other = changed(other, "symaware-cli", "symaware_cli/core/ghost.py", "0")
    answered = node_worker.answer(replace(setup, key="other", code=other), [0], False)
    assert not answered.rows
    message, *lines = (answered.trouble or "").splitlines()
    assert message.endswith(": other code than where the sweep was started: rows would not be comparable")
    assert lines == [
        "  numpy: numpy/version.py is another file there",
        "  symaware-cli: symaware_cli/core/agent.py is there, but not here",
        "  symaware-cli: symaware_cli/core/ghost.py is here, but not there",
    ]


def test_kernels_are_selected_before_python_starts(setup: SweepSetup, monkeypatch: pytest.MonkeyPatch) -> None:
    # Ray sets this variable for each task.
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    variables = {**setup.code["variables"], "OPENBLAS_CORETYPE": "Nehalem"}
    answered = node_worker.answer(replace(setup, key="other", code={**setup.code, "variables": variables}), [0], False)
    assert "OpenBLAS uses its kernel Nehalem" in (answered.trouble or "")
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert os.environ.get("OPENBLAS_CORETYPE") != "Nehalem"


def test_files_of_installed_and_editable_distributions_are_found() -> None:
    files = CodeIdentity.of_this_process().files
    assert any(name.startswith("numpy.libs/") for name in files["numpy"])
    assert "symaware_cli/studies/pool_worker.py" in files["symaware-cli"]
    assert not any("__pycache__" in name or ".dist-info" in name for each in files.values() for name in each)


@pytest.mark.parametrize("address", ["local", "cluster", "127.0.0.1:x", "127.0.0.1:99999"])
def test_invalid_addresses_are_rejected(address: str, tmp_path: Path) -> None:
    said = symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "--on", f"ray:{address}", status=2)
    assert f"the address of a Ray cluster is HOST:PORT or auto, not `{address}`" in said


def test_a_missing_cluster_is_reported_immediately(tmp_path: Path) -> None:
    said = symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "--on", "ray:127.0.0.1:9", status=2)
    assert "there is no Ray cluster at 127.0.0.1:9: " in said
    assert "`ray start --head` starts one" in said


def test_a_sweep_runs_on_this_machine_or_on_a_cluster(tmp_path: Path) -> None:
    said = symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "--on", "ray:auto", "--jobs", 0, status=2)
    assert "leave one out" in said
    assert not (tmp_path / "out").exists()
