"""Changes to a scenario: values by their paths, in the form of `--set`, so that problems can be located."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from os import PathLike, fspath
from typing import Any

FilePath = str | PathLike[str]

Changes = Mapping[str, Any] | Iterable[str]
"""Values by their paths, such as ``{"agents.robot.count": 8}``, or texts such as ``agents.robot.count=8``."""


def texts(changes: Changes | None) -> tuple[str, ...]:
    """Convert changes to the form of `--set`.

    Raises:
        TypeError: A value has a type that scenarios do not support.
    """
    if changes is None:
        return ()
    if isinstance(changes, Mapping):
        return tuple(f"{path}={_flow(value, path)}" for path, value in changes.items())
    if isinstance(changes, str):
        return (changes,)
    return tuple(changes)


def _flow(value: Any, path: str) -> str:
    """Write a value as YAML on one line."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_flow(str(key), path)}: {_flow(each, path)}' for key, each in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_flow(each, path) for each in value)}]"
    if hasattr(value, "tolist"):  # an array, or a number, of NumPy
        return _flow(value.tolist(), path)
    if isinstance(value, PathLike):
        return _flow(fspath(value), path)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    if value is None or isinstance(value, str | bool | int | float):
        return json.dumps(value, ensure_ascii=False)
    raise TypeError(f"{path}: a scenario holds no {type(value).__name__}")
