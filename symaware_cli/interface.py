"""The interface of a room: the names in its `__init__.pyi`, imported on first use.

Reasons: docs/decisions/0073-rooms.md
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

#: An import in a stub, on one line or in parentheses.
_IMPORT = re.compile(r"^from \.([\w.]+) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)


def interface_of(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package.

    A stub is read, so that type checkers and the interpreter have one list, and nothing is imported that is not used.

    Args:
        package: Its `__name__`.
        file: Its `__file__`; the stub is beside it.
    """
    homes = {}
    for module, several, one in _IMPORT.findall(Path(file).with_suffix(".pyi").read_text(encoding="utf-8")):
        for name in (several or one).split(","):
            if name.strip():
                homes[name.split()[0]] = module

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{homes[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    return get, lambda: sorted(homes), sorted(homes)
