"""Keeps the frames that the host sent to a member since the member's last checkpoint, and sends them again."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

#: The most bytes of them that are kept for one member.
_MOST = 2**28

#: The number of `Step`s before the latest one that are kept until the member has reported a checkpoint.
_RECENT = 64

#: The most `Step`s, and about the most bytes, that are sent again before the member has reported.
_AHEAD, _AHEAD_BYTES = 16, 2**16


class SentFrames:
    """Keeps the frames that a member needs to continue from its last checkpoint after its process died.

    Until a member has reported a checkpoint, only those of the latest `Step`s are kept: with a pace, some of them may
    have been sent before its report arrives.
    """

    def __init__(self) -> None:
        #: The frames, oldest first, each `Step` with its number.
        self._frames: deque[tuple[int | None, bytes]] = deque()
        self._bytes = 0
        #: The number of the `Step` after which all frames are kept, and of the latest one; None before the first.
        self._since: int | None = None
        self._latest: int | None = None
        self._has_checkpoint = False

    def add(self, data: bytes, step: int | None = None) -> None:
        """Add a frame.

        Args:
            data: The encoded frame.
            step: Its number, if it is a `Step`.
        """
        self._frames.append((step, data))
        self._bytes += len(data)
        if step is not None:
            self._latest = step
        if self._latest is None:
            return
        if self._since is None:
            self._forget(self._latest)
        if self._bytes > _MOST:
            self._has_checkpoint = False
        if not self._has_checkpoint:
            # Fewer if these are too many bytes as well.
            self._forget(self._latest if self._bytes > _MOST else self._latest - _RECENT)

    def keep_since(self, step: int) -> None:
        """Forget the frames that are no longer needed, as the member has stored its state after a `Step`."""
        if self._since is not None and self._latest is not None and self._since <= step <= self._latest:
            self._has_checkpoint = True
            self._forget(step)

    def _forget(self, step: int) -> None:
        """Forget a `Step` and the frames sent before it."""
        if self._since is not None and self._since >= step:
            return
        self._since = step
        while self._frames:
            number, data = self._frames.popleft()
            self._bytes -= len(data)
            if number == step:
                return

    def after(self, step: int) -> list[tuple[int | None, bytes]] | None:
        """Return the frames after a `Step`, with the number of each that is one; None if they are not kept."""
        if self._since is None or self._latest is None or not self._since <= step <= self._latest:
            return None
        frames = list(self._frames)
        numbers = [number for number, _ in frames]
        return frames[numbers.index(step) + 1 :] if step in numbers else frames


class RepeatedFrames:
    """The frames that are sent to a member again, and those that follow them.

    Only some are sent ahead of the member's reports, because the queue of a connection is bounded.
    """

    def __init__(self, frames: Iterable[tuple[int | None, bytes]] = ()) -> None:
        """Initialise.

        Args:
            frames: The encoded frames in order, with the number of each that is a `Step`.
        """
        self._frames = deque(frames)
        #: The number and the size of each `Step` that was sent and not reported.
        self._ahead: deque[tuple[int, int]] = deque()

    def __bool__(self) -> bool:
        """Whether there are frames to send."""
        return bool(self._frames)

    def add(self, data: bytes, step: int | None = None) -> None:
        """Add a frame; the arguments are those of `SentFrames.add`."""
        self._frames.append((step, data))

    def due(self, heard: int) -> Iterator[bytes]:
        """Remove the frames that are to be sent now, and return them.

        Args:
            heard: The last step that the member has reported.
        """
        ahead = self._ahead
        while ahead and ahead[0][0] <= heard:
            ahead.popleft()
        while self._frames and len(ahead) < _AHEAD and sum(size for _, size in ahead) < _AHEAD_BYTES:
            step, data = self._frames.popleft()
            if step is not None:
                ahead.append((step, len(data)))
            yield data
