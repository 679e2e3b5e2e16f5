"""Plans every sweep, and makes one run of each of its combinations, all of which must be done.

    .venv/bin/python .ci/sweeps.py FOLDER SWEEP...

Tables are written into the folder. All is done in this process, because to start the program and its workers takes as
long as many a run.
"""

from __future__ import annotations

import sys
from pathlib import Path

from symaware_cli.cli.application import application


def main() -> None:
    """Try all sweeps, and exit with 1 if one of them failed."""
    folder, failed = Path(sys.argv[1]), []
    for sweep in map(Path, sys.argv[2:]):
        print(f"{sweep}", flush=True)
        table = str(folder / "-".join(sweep.with_suffix("").parts))
        runs = ["sweep", str(sweep), "--runs", "1", "--with", "claim=none", "--jobs", "0", "--output", table]
        if status(["plan", str(sweep)]) or status(runs):
            failed.append(sweep)
            print(f"{sweep}: FAILED", flush=True)
    print(f"{len(sys.argv[2:])} sweeps, {len(failed)} failed")
    sys.exit(bool(failed) or not sys.argv[2:])


def status(words: list[str]) -> int:
    """Call the program, and return its exit status."""
    try:
        application(words)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(bool(end.code))
    finally:
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    main()
