"""Comparison of the messages of a run with those of a log, during the run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import takewhile

from symaware_cli.log import TIMING, Log, LogDifference, LogMessage, message_differences


class MessageComparison:
    """Compares the messages of a log with those of a run as they are written.

    Attributes:
        is_whole: Whether all of the log is compared; otherwise only the messages before some instant, because the log
            may contain only a part of that instant.
        differs: Whether a message differed.
        count: The number of equal messages, and of those that differ within the tolerance.
        now: The time of the last of them [ns].
        tolerated: The number of messages that differ within the tolerance.
        greatest: The greatest difference of two numbers within the tolerance; None if there is none.
    """

    def __init__(
        self, log: Log, until: int | None = None, allowed: Callable[[LogDifference], bool] | None = None
    ) -> None:
        """Begin with the first message.

        Args:
            log: The log.
            until: The instant before which messages are compared [ns]; None for the whole log or, if the log does not
                reach the end of its run, to compare up to its last instant, which is excluded.
            allowed: Tells which differences between elements of messages are within the tolerance; None if none is.
        """
        status = (log.outcome or {}).get("status")
        self.is_whole = until is None and status in ("finished", "failed")
        self.differs = False
        self.count = self.now = self.tolerated = 0
        self.greatest: LogDifference | None = None
        self._log = log
        self._allowed = allowed
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
        if expected is None or (expected.channel.topic, expected.time) != (topic, time):
            self.differs = True
            return
        if expected.data != data and not self._is_within(expected, data):
            self.differs = True
            return
        self.count, self.now = self.count + 1, time
        self._next = next(self._expected, None)

    def _is_within(self, expected: LogMessage, data: bytes) -> bool:
        """Whether a message with other bytes is within the tolerance."""
        if self._allowed is None:
            return False
        repeated = replace(expected, data=data, content=None)
        for difference in message_differences(expected, repeated, self._log, self._log):
            if not self._allowed(difference):
                return False
            if (difference.distance or 0.0) > (0.0 if self.greatest is None else self.greatest.distance or 0.0):
                self.greatest = difference
        self.tolerated += 1
        return True
