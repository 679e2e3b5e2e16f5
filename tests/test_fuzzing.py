"""The fuzzing tool, with a target that does everything a target must not; and the cases of its corpus again."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from fuzzing.campaign import pursue, replay
from fuzzing.state import State
from fuzzing.targets import target, target_names

ROOT = Path(__file__).parent.parent
CORPUS = Path(__file__).parent / "corpus"
AWKWARD = "awkward.target"
KINDS = {
    "raises": ("traceback", "ValueError"),
    "finds": ("unreadable", "cannot be read"),
    "leaves": ("traceback", "SystemExit"),
    "hangs": ("hang", "in attempt"),
    "crashes": ("crash", "SIGSEGV"),
    "ends": ("crash", "exit status 0"),
    "eats": ("memory", "MB more"),
    "devours": ("memory", "MemoryError"),
}


@pytest.mark.parametrize("name", [name for name in target_names() if any((CORPUS / name).glob("*"))])
def test_earlier_findings_stay_fixed(name: str) -> None:
    tried = list(replay(name, sorted((CORPUS / name).glob("*"))))
    assert [(path.name, result.found) for path, result in tried if result.found] == []


def test_each_folder_of_the_corpus_has_a_target() -> None:
    assert {path.name for path in CORPUS.glob("*")} <= set(target_names())


@pytest.mark.parametrize("name", target_names())
def test_cases_depend_on_nothing_but_their_seed(name: str, tmp_path: Path) -> None:
    """Otherwise a campaign could not be repeated."""
    lines = [
        "import pathlib, random, sys",
        "from fuzzing.targets import target",
        f"made = target({name!r})",
        f"made.prepare(pathlib.Path({str(tmp_path)!r}) / sys.argv[1])",
        "import hashlib",
        f"count = {2 if name == 'compositions' else 10}",  # to compose one takes half a second
        "print([hashlib.sha256(made.make(random.Random(str(k)))).hexdigest() for k in range(count)])",
    ]
    outputs = set()
    for seed in ("1", "2"):
        (tmp_path / seed).mkdir()
        done = subprocess.run(
            [sys.executable, "-c", "\n".join(lines), seed],
            env={**os.environ, "PYTHONHASHSEED": seed},
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
        outputs.add(done.stdout)
    assert len(outputs) == 1


@pytest.mark.parametrize("content", KINDS)
def test_a_worker_survives_and_reports(content: str, tmp_path: Path) -> None:
    files = [tmp_path / f"{number}" for number in range(3)]
    for path, word in zip(files, ("fine", content, "fine"), strict=True):
        path.write_text(word)
    results = [result for _, result in replay(AWKWARD, files)]
    assert [dict(result.tally) for result in results] == [{"fine": 1}, {}, {"fine": 1}]
    found = results[1].found
    kind, text = KINDS[content]
    assert found is not None
    assert (found.kind, results[1].case) == (kind, content.encode())
    assert text in found.text


def pursued(state: Any, **options: Any) -> Any:
    pursue({AWKWARD: state}, **{"minutes": 5, "cases": 12, "jobs": 2, "report": lambda name, result: None, **options})
    return state


def test_a_campaign_continues_with_the_same_cases(tmp_path: Path) -> None:
    at_once = pursued(State.load(tmp_path / "a", 3))
    for cases in (1, 5, 12):
        in_parts = pursued(State.load(tmp_path / "b", 3), cases=cases, jobs=1)
        assert in_parts.done == cases
    assert at_once.tally == in_parts.tally
    assert at_once.findings.keys() == in_parts.findings.keys()
    (found,) = at_once.findings.values()
    assert found["count"] == 12 - at_once.tally["fine"] > 0
    assert Path(found["files"][0]).read_bytes() == b"raises"
    assert State.load(tmp_path / "a", 4).done == 0


def test_cases_that_were_not_done_come_first(tmp_path: Path) -> None:
    state = State.load(tmp_path, 3)
    first = state.take()
    state.save()
    again = State.load(tmp_path, 3)
    assert again.pending == [first]
    assert pursued(again, cases=4).done == 4
    assert (again.next, again.pending) == (4, [])


def test_ctrl_c_leaves_no_process_and_loses_no_case(tmp_path: Path) -> None:
    line: list[str | Path] = [sys.executable, "-m", "fuzzing", "--target", "logs", "--state", tmp_path / "state", "5"]
    process = subprocess.Popen(
        line, cwd=ROOT, stdout=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": str(tmp_path)}
    )
    while not list(tmp_path.glob("fuzz-*/here")):
        time.sleep(0.05)
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "cases in" in output
    assert [path.name for path in tmp_path.iterdir()] == ["state"]
    state = State.load(tmp_path / "state" / "logs", 1)
    assert state.done + len(state.pending) == state.next


def test_every_target_is_bounded() -> None:
    for name in target_names():
        assert 0 < target(name).time_limit <= 600
        assert target(name).address_space <= 16 << 30
