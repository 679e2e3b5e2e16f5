"""Comparison of the messages of a run with those of a log, during the run."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import takewhile

from symaware_cli.log import TIMING, Log, LogMessage


class MessageComparison:
    """Compares the messages of a log with those of a run as they are written.

    Attributes:
        is_whole: Whether all of the log is compared; otherwise only the messages before some instant, because the log
            may contain only a part of that instant.
        differs: Whether a message differed.
        count: The number of equal messages.
        now: The time of the last equal message [ns].
    """

    def __init__(self, log: Log, until: int | None = None) -> None:
        """Begin with the first message.

        Args:
            log: The log.
            until: The instant before which messages are compared [ns]; None for the whole log or, if the log does not
                reach the end of its run, to compare up to its last instant, which is excluded.
        """
        status = (log.outcome or {}).get("status")
        self.is_whole = until is None and status in ("finished", "failed")
        self.differs = False
        self.count = self.now = 0
        messages = log.messages(topic for topic in log.channels if topic != TIMING)
        end = (log.end_time or 0) if until is None else until
        self._messages = messages
        self._expected: Iterator[LogMessage] = (
            messages if self.is_whole else takewhile(lambda message: message.time < end, messages)
        )
        self._next = next(self._expected, None)

    @property
    def is_left(self) -> bool:
        """Whether the log has messages that the run has not yet written."""
        return self._next is not None

    @property
    def is_over(self) -> bool:
        """Whether the comparison is finished."""
        return self.differs or (not self.is_whole and not self.is_left)

    def close(self) -> None:
        """Close the log and end the comparison."""
        self._messages.close()

    def compare(self, topic: str, time: int, data: bytes) -> None:
        """Compare the next message."""
        expected = self._next
        if self.is_over:
            return
        if expected is None or (expected.channel.topic, expected.time, expected.data) != (topic, time, data):
            self.differs = True
            return
        self.count, self.now = self.count + 1, time
        self._next = next(self._expected, None)
