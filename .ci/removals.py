"""Removes features from an installed copy of the package, and runs the tests of the floors below them.

`.venv/bin/python .ci/removals.py [NAME ...] [-- PYTEST OPTIONS]`, where a name is a room or a module of the package,
such as `views` or `worlds/planar`. Without names, all features are removed together; `--each` removes one after the
other. Tests of the lower floors that use what was removed are left out (tests/features.py).
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

TOP = Path(__file__).parents[1]
sys.path.insert(0, str(TOP / "tests"))

from features import FEATURES  # noqa: E402

#: Two worlds, an export, a fault, a verb.
SINGLE = ("worlds/planar", "worlds/spatial", "views/exporting/text", "engine/faults/push", "cli/export")
FOLDERS = ("core", "awareness", "world", "geometry", "specification", "engine", "language", "log")


def removed(copy: Path, names: Sequence[str]) -> None:
    """Delete rooms or modules of a copy, and the entry points that lead to them."""
    for name in names:
        place = copy / "symaware_cli" / name
        if place.is_dir():
            shutil.rmtree(place)
        else:
            place.with_suffix(".py").unlink()
    (points,) = copy.glob("symaware_cli-*.dist-info/entry_points.txt")
    gone = re.compile("|".join(rf"= symaware_cli\.{name.replace('/', '.')}[.:]" for name in names))
    kept = [line for line in points.read_text(encoding="utf-8").splitlines() if not gone.search(line)]
    points.write_text("\n".join(kept) + "\n", encoding="utf-8")


def tested(names: Sequence[str], options: Sequence[str]) -> int:
    """Run the tests of the lower floors without some features; return the status of pytest."""
    with tempfile.TemporaryDirectory() as folder:
        install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", folder, str(TOP)]
        subprocess.run(install, check=True)
        removed(Path(folder), names)
        print(f"without {', '.join(names)}:", flush=True)
        # The checkout is not on the path: what was deleted must not be found there.
        line = [sys.executable, "-P", "-m", "pytest", "-o", "pythonpath=", *options]
        path = os.pathsep.join(filter(None, (folder, os.environ.get("PYTHONPATH"))))
        environment = {**os.environ, "PYTHONPATH": path}
        return subprocess.run([*line, *(f"tests/{each}" for each in FOLDERS)], cwd=TOP, env=environment).returncode


def main(arguments: Sequence[str]) -> int:
    """Remove what was asked for."""
    end = list(arguments).index("--") if "--" in arguments else len(arguments)
    before, options = arguments[:end], arguments[end + 1 :]
    names = [each for each in before if each != "--each"]
    if "--each" in before:
        return max(tested([name], options) for name in names or (*sorted(FEATURES), *SINGLE))
    return tested(names or sorted(FEATURES), options)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
