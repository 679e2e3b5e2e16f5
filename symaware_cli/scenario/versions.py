"""The versions of what is installed, and what computes: on what a run depends besides its scenario."""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path

from symaware_cli import processor

#: The folder (or file) that an installed distribution leaves on the path is called by its name and version.
_INFORMATION = re.compile(r"(?P<name>.+?)-(?P<version>[^-]+)(-py[\d.]+)?\.(dist|egg)-info")


def versions() -> dict[str, str]:
    """The version of Python, the platform, what computes, and the version of every installed distribution, by name.

    Names of distributions are normalized (https://packaging.python.org/specifications/name-normalization), so they have
    no capitals.
    """
    return {
        "Python": platform.python_version(),
        "platform": platform.platform(),
        **processor.in_force(),
        **_distributions(tuple(sys.path)),
    }


@cache
def _distributions(path: tuple[str, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for folder in path:
        for name, version in _in_folder(folder or "."):
            # Of two, the one that is imported counts.
            found.setdefault(re.sub(r"[-_.]+", "-", name).lower(), version)
    return dict(sorted(found.items()))


def _in_folder(folder: str) -> Iterator[tuple[str, str]]:
    """What is installed in a folder: from the names of files, which takes a tenth of the time of reading them."""
    try:
        entries = sorted(os.listdir(folder))
    except OSError:  # such as a ZIP file
        entries = []
        for each in metadata.distributions(path=[folder]):
            yield from _told(each)
    for entry in entries:
        if entry.endswith((".dist-info", ".egg-info")):
            match = _INFORMATION.fullmatch(entry)
            if match:
                yield match["name"], match["version"]
            else:
                yield from _told(metadata.PathDistribution(Path(folder, entry)))


def _told(distribution: metadata.Distribution) -> Iterator[tuple[str, str]]:
    """What a distribution says of itself, in its file of metadata."""
    if distribution.metadata["Name"]:
        yield distribution.metadata["Name"], distribution.metadata["Version"] or ""
