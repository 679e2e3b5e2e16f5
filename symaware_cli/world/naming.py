"""Names and numbers in messages: quoted, listed, counted, and the valid name nearest to an invalid one."""

import difflib
import os
from collections.abc import Iterable
from itertools import islice
from pathlib import Path


def nearest(name: str, candidates: Iterable[str]) -> str | None:
    """Returns the candidate that `name` was probably meant to be, if one is similar enough."""
    # The comparison is quadratic in the length, so long names are not compared.
    if len(name) > 100:
        return None
    known = {candidate.lower(): candidate for candidate in islice(candidates, 1000) if len(candidate) <= 100}
    found = difflib.get_close_matches(name.lower(), known, n=1, cutoff=0.6)
    return known[found[0]] if found else None


def nearest_file(path: Path, suffixes: tuple[str, ...]) -> str | None:
    """Returns the file in the same folder that was probably meant by the name of a missing one, if one is similar.

    Args:
        path: The missing file.
        suffixes: The endings of the names of files of its kind.
    """
    try:
        with os.scandir(path.parent) as entries:
            names = sorted(entry.name for entry in entries if entry.name.endswith(suffixes))
    except (OSError, ValueError):
        return None
    # Without the suffixes, which would make all names similar.
    stems = {name.rpartition(".")[0]: name for name in reversed(names)}
    found = nearest(path.stem if path.suffix in suffixes else path.name, stems)
    return stems[found] if found else None


def listed(names: Iterable[str], most: int = 6) -> str:
    """Returns the first names as text, and the number of the others, such as ``a, b and 3 more``."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most:,} more" if len(names) > most else "")


def counted(number: int, noun: str) -> str:
    """Returns a number with a noun, such as ``1 agent`` or ``4,000 agents``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def quoted(text: str, limit: int = 60) -> str:
    """Returns text from a file in backticks, without its middle if it is long."""
    half = limit // 2
    return f"`{text if len(text) <= limit else text[:half] + '...' + text[-half:]}`"
