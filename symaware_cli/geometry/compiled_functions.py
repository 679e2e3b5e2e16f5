"""Functions on arrays that the optional package `symaware_compiled` replaces by compiled ones, which return equal bits.

What stands here in NumPy is the reference. Reasons: docs/decisions/0120-compiled-functions.md
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

#: The edition of the functions that are marked here; raised when the result of one of them changes.
EDITION = 1

#: The functions that are marked, as they stand here, by name.
REFERENCES: dict[str, Callable[..., Any]] = {}


def _installed() -> tuple[Any, str]:
    """Return the package, or None and why it is not used."""
    try:
        package = importlib.import_module("symaware_compiled")
    except ModuleNotFoundError:
        return None, "symaware-compiled is not installed"
    except ImportError as error:
        return None, f"symaware_compiled cannot be imported: {error}"
    if package.EDITION != EDITION:
        return None, f"symaware_compiled has edition {package.EDITION} of the functions, not {EDITION}"
    return package, ""


_package, _problem = _installed()


def why_not_compiled() -> str:
    """Return why the functions are those in NumPy; empty if they are compiled."""
    return _problem


def compiled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return the compiled function of this name if there is one, which returns the same bits; else the function."""
    if function.__name__ in REFERENCES:
        raise ValueError(f"two functions to be compiled have the name {function.__name__}")
    REFERENCES[function.__name__] = function
    chosen: Callable[Arguments, Result] = function if _package is None else _package.replaced(function)
    return chosen
