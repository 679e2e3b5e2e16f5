"""What can be wrong with a sweep beyond what a file says."""

from collections.abc import Sequence

from symaware_cli.recording.error import LogError


class SweepError(LogError):
    """A folder is not what is needed, or does not fit what is asked for."""


def listed(message: str, lines: Sequence[str]) -> str:
    """A message, and below it the first lines of what it is about."""
    more = [f"and {len(lines) - 20} more"] if len(lines) > 20 else []
    return "\n  ".join([message, *lines[:20], *more])
