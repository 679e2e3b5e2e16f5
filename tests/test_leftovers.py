"""Memory that is not released is found, and memory that is needed once is not mistaken for it."""

import subprocess
import sys
from pathlib import Path

import pytest

KEEPING = "kept.append(b'1' * 200_000)"


@pytest.mark.parametrize(
    ("action", "grows"), [(KEEPING, True), (f"{KEEPING} if len(kept) < 12 else None", False), ("b'1' * 200_000", False)]
)
def test_memory_that_each_repeat_keeps_is_a_leak_and_what_a_few_keep_is_none(action: str, grows: bool) -> None:
    # In a process of its own, as one with much memory reuses what earlier tests released.
    code = f"kept = []; print(grows_forever(lambda: {action}, repeats=5, each=10_000))"
    done = subprocess.run(
        [sys.executable, "-c", f"from leftovers import grows_forever; {code}"],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == f"{grows}\n"
