"""What can be wrong with a sweep beyond what a file says."""

from collections.abc import Collection, Sequence

from symaware_cli.language import nearest
from symaware_cli.log import LogError


class SweepError(LogError):
    """A folder is not what is needed, or does not fit what is asked for."""


class LostResultError(SweepError):
    """The process that was to make a result died or exceeded its time, and the work cannot continue without it."""

    status = 1


def listed(message: str, lines: Sequence[str]) -> str:
    """A message, and below it the first lines of what it is about."""
    more = [f"and {len(lines) - 20} more"] if len(lines) > 20 else []
    return "\n  ".join([message, *lines[:20], *more])


def unknown_specification(name: str, known: Collection[str]) -> SweepError:
    """The error for a specification that the scenario does not have."""
    near = nearest(name, known)
    hint = f"did you mean `{near}`?" if near else f"it has {', '.join(known) or 'no specifications'}"
    return SweepError(f"the scenario has no specification `{name}`; {hint}")
