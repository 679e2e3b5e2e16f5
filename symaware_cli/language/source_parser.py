"""Reads a scenario file within bounds, and parses it as YAML or TOML according to its suffix."""

import os
import stat
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path as FilePath

from symaware_cli.language.problem import ScenarioError, quoted
from symaware_cli.language.source import MAX_BYTES, Source, decode
from symaware_cli.world import nearest_file

#: What the names of scenarios end with.
SUFFIXES = (".yaml", ".yml", ".toml")


def load(path: FilePath, name: str) -> Source:
    """Reads a scenario file.

    Args:
        path: The file.
        name: Its name in messages.

    Raises:
        ScenarioError: The file cannot be read or parsed; contains every problem found in it.
    """
    source = read(path, name)
    if source.problems:
        raise ScenarioError(source.problems)
    return source


def read(path: FilePath, name: str) -> Source:
    """Reads a scenario file; its problems are in `problems` of the result."""
    source = read_text(path, name, "a scenario file", SUFFIXES)
    if source.problems:
        return source
    parsed = _parsed(source.name, source.raw, path.suffix.lower() == ".toml")
    source.problems += parsed.problems
    source.root = parsed.root
    return source


# The runs of a sweep or a search read the same few files again and again, with other values for `--set`.
@lru_cache(maxsize=8)
def _parsed(name: str, raw: bytes, is_toml: bool) -> Source:
    """Parse the text of a scenario file; the result is shared, and its tree immutable."""
    source = decode(name, raw)
    # Imported here, so that reading one format does not import the parser of the other.
    if is_toml:
        from symaware_cli.language.toml_source import parse_toml as parse
    else:
        from symaware_cli.language.yaml_source import parse_yaml as parse
    parse(source)
    _check_top(source)
    return source


def read_text(path: FilePath, name: str, kind: str, suffixes: Sequence[str]) -> Source:
    """Reads the text of a file; its problems are in `problems` of the result.

    Args:
        path: The file.
        name: Its name in messages.
        kind: The kind of file, for messages, such as "a scenario file".
        suffixes: The suffixes that it may have, in lower case.
    """
    source, shown = Source(name, b""), quoted(name, 200)
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISDIR(mode):
            source.report("not-a-file", f"{shown} is a folder", None, expected=kind)
            return source
        if not stat.S_ISREG(mode):
            # A pipe or a device could block or never end.
            source.report("not-a-file", f"{shown} is not a regular file", None, expected=kind)
            return source
        if path.suffix.lower() not in suffixes:
            expected = f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"
            source.report("unknown-format", f"{shown} has an unknown suffix", None, expected=expected)
            return source
        with open(path, "rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        suggestion = nearest_file(path, tuple(suffixes))
        source.report("missing-file", f"there is no file {shown}", None, suggestion=suggestion)
        return source
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        source.report("unreadable", f"{shown} cannot be read: {reason}", None)
        return source
    if len(raw) > MAX_BYTES:
        source.report("too-large", f"{shown} is larger than 1 MiB, the most {kind} may have", None)
        return source
    return decode(name, raw)


def _check_top(source: Source) -> None:
    """Reports an empty document, or one that is not a mapping."""
    root = source.root
    if root is None:
        if not source.problems:
            source.report("empty", "the file is empty", source.text_span(1, 1, 1, 2), expected="a scenario")
    elif not isinstance(root.value, dict):
        source.root = None
        if source.problems:
            return
        kind = "a list" if isinstance(root.value, list) else "a single value"
        message = f"the file holds {kind} instead of keys and values"
        source.report("not-a-mapping", message, root.span, expected="keys and values at the top level")
