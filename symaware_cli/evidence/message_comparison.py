"""Compares the messages of a run with those of a log, while the run goes on."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import takewhile

from symaware_cli.log import TIMING, Log, LogMessage


class MessageComparison:
    """Compares the messages of a log with those of a run, as they come.

    Attributes:
        is_whole: Whether all of the log is compared; otherwise the messages before some instant are, as an instant may
            be in the log in part.
        differs: Whether a message was another one.
        count: How many were equal.
        now: The time of the last one that was equal [ns].
    """

    def __init__(self, log: Log, until: int | None = None) -> None:
        """Begin with the first message.

        Args:
            log: The log.
            until: The instant before which messages are compared [ns]; None for the whole log, or as far as a log goes
                that does not reach the end of its run.
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
        """Whether the log has messages that did not come yet."""
        return self._next is not None

    @property
    def is_over(self) -> bool:
        """Whether nothing is left to compare."""
        return self.differs or (not self.is_whole and not self.is_left)

    def close(self) -> None:
        """Close the log, of which nothing more is compared."""
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
