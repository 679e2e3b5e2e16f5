"""The fuzzing targets: each module here defines one, as `TARGET`."""

import importlib
import pkgutil

from fuzzing.target import Target


def target_names() -> list[str]:
    """The names of all targets, sorted: those of the modules in this folder."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def target(name: str) -> Target:
    """Import a target.

    Args:
        name: One of `target_names()`, or a module elsewhere with dots in its name.
    """
    found: Target = importlib.import_module(name if "." in name else f"{__name__}.{name}").TARGET
    return found
