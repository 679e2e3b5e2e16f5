"""Counts the physical lines of the product by room: without tests, benchmarks, fuzzing and generated code.

`python .ci/lines.py` prints a table; with a number, the exit status is 1 if the product has more lines than that.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

TOP = Path(__file__).parents[1]
PACKAGE = TOP / "symaware_cli"
KINDS = {".py", ".pyi", ".js", ".css", ".html"}
#: The floors below the features, with the stock of models and components.
CORE = {"core", "awareness", "world", "geometry", "specification", "assets", "engine", "language", "log"}


def is_counted(file: Path) -> bool:
    """Whether a file is part of the product, and written by people."""
    return file.suffix in KINDS and not file.stem.endswith("_pb2")


def counts() -> Counter[str]:
    """The lines of each room of the package, and of each plugin of the repository."""
    found: Counter[str] = Counter()
    for file in filter(is_counted, PACKAGE.rglob("*")):
        place = file.relative_to(PACKAGE).parts
        found[place[0] if len(place) > 1 else "(public modules)"] += len(file.read_text(encoding="utf-8").splitlines())
    for plugin in sorted((TOP / "plugins").iterdir()):
        for file in filter(is_counted, (plugin / "src").rglob("*")):
            found[f"plugins/{plugin.name}"] += len(file.read_text(encoding="utf-8").splitlines())
    return found


def main() -> int:
    """Print the table."""
    found = counts()
    for room, lines in found.most_common():
        print(f"{lines:8,}  {room}")
    product = found.total()
    print(f"{sum(lines for room, lines in found.items() if room in CORE):8,}  below the features")
    print(f"{product:8,}  in all")
    return int(len(sys.argv) > 1 and product > int(sys.argv[1]))


if __name__ == "__main__":
    sys.exit(main())
