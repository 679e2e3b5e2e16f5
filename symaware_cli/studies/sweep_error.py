"""Errors of sweeps, apart from invalid documents."""

from collections.abc import Collection, Sequence

from symaware_cli.language import nearest
from symaware_cli.log import LogError


class SweepError(LogError):
    """A sweep folder is missing, damaged or in use, or does not match the request."""


class LostResultError(SweepError):
    """The process computing a result died or exceeded its time, and the work cannot continue without the result."""

    status = 1


def listed(message: str, lines: Sequence[str]) -> str:
    """Return a message followed by the first of the lines that it refers to."""
    more = [f"and {len(lines) - 20} more"] if len(lines) > 20 else []
    return "\n  ".join([message, *lines[:20], *more])


def unknown_specification(name: str, known: Collection[str]) -> SweepError:
    """Return the error for an unknown specification."""
    near = nearest(name, known)
    hint = f"did you mean `{near}`?" if near else f"it has {', '.join(known) or 'no specifications'}"
    return SweepError(f"the scenario has no specification `{name}`; {hint}")
