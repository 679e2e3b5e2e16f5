"""What can be wrong with a sweep beyond what a file says."""

from symaware_cli.recording.error import LogError


class SweepError(LogError):
    """A folder is not what is needed, or does not fit what is asked for."""
