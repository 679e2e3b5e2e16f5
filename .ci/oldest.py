"""Checks that oldest.txt names, for each package that pyproject.toml asks for, the oldest version that it allows."""

import re
import sys
import tomllib
from pathlib import Path


def number(version: str) -> tuple[int, ...]:
    """A version that can be compared: 2.0 and 2.0.0 are the same."""
    parts = [int(part) for part in version.split(".")]
    while parts and parts[-1] == 0:
        parts.pop()
    return tuple(parts)


project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
extras = project["optional-dependencies"]
wanted = [
    *project["dependencies"],
    *(each for name, group in extras.items() if name not in ("all", "dev") for each in group),
]
allowed = dict(re.findall(r"^([\w-]+)>=([\d.]+)", each)[0] for each in wanted)
named = dict(line.split("==") for line in Path(__file__).with_suffix(".txt").read_text().split())
wrong = [
    f"{name}: pyproject.toml allows {version}, oldest.txt names {named.get(name, 'none')}"
    for name, version in allowed.items()
    if name not in named or number(named[name]) != number(version)
]
print(*wrong, sep="\n") if wrong else print(f"{len(allowed)} packages")
sys.exit(bool(wrong))
