"""The shared beginning of branches: the run up to their instant, executed once, from whose state branches continue."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

from symaware_cli.core import nanoseconds
from symaware_cli.core.stateful import StateError
from symaware_cli.engine import Fault, Run, SimulationState, capture, restore
from symaware_cli.evidence.branch_changes import BranchError
from symaware_cli.evidence.message_comparison import MessageComparison
from symaware_cli.language import Assignment, dotted, open_scenario, prepared
from symaware_cli.language.build import Built
from symaware_cli.log import TIMING, Log, LogWriter, Recorder
from symaware_cli.version import __version__

#: The number of steps between two checks that the run still equals the log.
STEPS = 100


class SharedBeginning:
    """The run of a log up to the last step before an instant.

    Attributes:
        state: The state of the run there; None if it cannot be captured.
        obstacle: Why there is no state; None if there is one.
    """

    def __init__(
        self, log: Path, original: Log, instant: float, on_progress: Callable[[int, int], object] | None = None
    ) -> None:
        """Repeat the run to the instant, and capture its state.

        Args:
            log: The log.
            original: The same log, opened.
            instant: The instant [s].
            on_progress: Called periodically with the number of completed steps and the total.

        Raises:
            BranchError: The repeated run differs from the log.
            LogError: The log cannot be read.
            KeyboardInterrupt: A signal ended the run.
        """
        self.state: SimulationState | None = None
        self.obstacle = ""
        self._original = original
        self._instant = nanoseconds(instant)
        self._messages = 0
        built = open_scenario(log)
        self._faults: Sequence[Fault] = built.options.faults
        self._sections = _sections(built)
        self._time_step = built.simulation.environment.time_step
        steps = min(self._instant // self._time_step, built.steps - 1)
        if steps < 1:
            self.obstacle = "nothing was done before the instant"
            return
        comparison = MessageComparison(original, self._instant)
        digest = hashlib.sha256(built.resolved).hexdigest()
        with (
            closing(comparison),
            tempfile.TemporaryDirectory() as folder,
            prepared(built, Path(folder, "beginning.mcap"), may_exit=False, on_message=comparison.compare) as run,
        ):
            while run.status is None and run.done < steps and not comparison.differs:
                run.advance(min(STEPS, steps - run.done))
                if on_progress is not None:
                    on_progress(run.done, built.steps)
            if run.signal is not None:
                raise KeyboardInterrupt
            if comparison.differs:
                where = f"it differs from {log} after {comparison.now / 1e9:g} s already"
                raise BranchError(
                    f"there is no branch: {where}; the run is irreproducible. See `symaware verify {log}`"
                )
            try:
                self.state = capture(run, digest, __version__)
                self._messages = _writer(run).sequence
            except StateError as error:
                self.obstacle = str(error)
            run.leave("the branches continue from here")

    def obstacle_of(self, built: Built, overrides: Sequence[Assignment]) -> str | None:
        """Return why a branch cannot continue from the state; None if it can.

        Args:
            built: The branch's scenario.
            overrides: Its changes to the scenario of the log.
        """
        if self.state is None:
            return self.obstacle
        for each in overrides:
            if each.path[0] == "run":
                return f"`{dotted(each.path)}` acts from the beginning of a run"
        count = len(self._faults)
        if _sections(built)[:count] != self._sections:
            return "a fault of the log is changed"
        ends = [each.at + each.lasting for each in self._faults if each.at is not None and each.lasting is not None]
        is_open = any(each.on is not None and each.lasting is not None for each in self._faults)
        for fault in built.options.faults[count:]:
            if fault.at is None or fault.at < self._instant:
                return f"the fault `{fault.name}` may begin earlier"
            if fault.effect_before is not None:
                return fault.effect_before
            if is_open or any(abs(end - fault.at) < self._time_step for end in ends):
                return f"another fault may end as `{fault.name}` begins"
        return None

    def continue_in(self, run: Run) -> None:
        """Start the run of a branch with the messages of the log, and continue it from the state.

        Args:
            run: The run, which has not made a step, and for which `obstacle_of` returned None.

        Raises:
            StateError: The state cannot be restored in the run.
            LogError: A log cannot be read or written.
        """
        assert self.state is not None
        run.advance(0)
        writer = _writer(run)
        original = self._original
        channels = dict(writer.channels)
        with closing(original.messages(topic for topic in original.channels if topic != TIMING)) as messages:
            # The run itself wrote the first messages when it began.
            for message in islice(messages, writer.sequence, self._messages):
                topic = message.channel.topic
                if topic not in channels:  # some channels, such as those of scans, are opened for their first message
                    name = message.channel.schema.rpartition(".")[2]
                    channels[topic] = writer.channel(topic, name, message.channel.metadata)
                writer.add(channels[topic], message.time, message.data)
        restore(run, self.state, self.state.scenario, __version__)
        run.begin_faults(len(self._faults))


def _sections(built: Built) -> list[tuple[str, Any]]:
    """Return the fault sections of a scenario, in order."""
    return [*(built.data.get("faults") or {}).items()]


def _writer(run: Run) -> LogWriter:
    assert isinstance(run.recorder, Recorder)
    return run.recorder.writer
