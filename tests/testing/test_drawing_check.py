"""Drawings that break a rule are named, with the method and a correction."""

import random
from itertools import count
from typing import Any, ClassVar

import numpy as np
import pytest
from deviating import deviations

from symaware_cli.drawings import Curves, Drawing
from symaware_cli.testing import check_drawing


class Heights(Drawing):
    """A valid drawing of a coordinate of each agent."""

    panel: ClassVar = "heights"

    def marks(self, chunk: Any) -> Any:
        for name, view in self.run_view.group_views.items():
            frames = chunk.frames.get(view.state_topic)
            if frames is not None and len(frames.times):
                yield self.curve(name, view, frames)

    def curve(self, name: str, view: Any, frames: Any) -> Any:
        values = frames.values[:, :, 1]
        return Curves(path=f"curves/heights/{name}", times=frames.times, values=values, names=view.agents)


class Listing(Heights):
    """Draws lists."""

    def curve(self, name: str, view: Any, frames: Any) -> Any:
        return frames.values.tolist()


class Rooted(Heights):
    """Draws at a path with a slash."""

    def curve(self, name: str, view: Any, frames: Any) -> Any:
        return Curves(path="/curves", times=frames.times, values=frames.values[:, :, 1], names=view.agents)


class Seconds(Heights):
    """Draws at times in seconds."""

    def curve(self, name: str, view: Any, frames: Any) -> Any:
        values = frames.values[:, :, 1]
        return Curves(path=f"curves/heights/{name}", times=frames.times / 1e9, values=values, names=view.agents)


class Overwriting(Heights):
    """Changes the chunk."""

    def curve(self, name: str, view: Any, frames: Any) -> Any:
        frames.values.flags.writeable = True
        frames.values[:, :, 1] += 1.0
        return super().curve(name, view, frames)


class Elsewhere(Heights):
    """Draws curves beside its panel."""

    def curve(self, name: str, view: Any, frames: Any) -> Any:
        values = frames.values[:, :, 1]
        return Curves(path=f"curves/depths/{name}", times=frames.times, values=values, names=view.agents)


class Rolling(Heights):
    """Draws from the global generator."""

    def marks(self, chunk: Any) -> Any:
        random.random()
        return super().marks(chunk)


NUMBERS = count()


class Counting(Heights):
    """Draws other curves each time."""

    def curve(self, name: str, view: Any, frames: Any) -> Any:
        values = frames.values[:, :, 1] + next(NUMBERS)
        return Curves(path=f"curves/heights/{name}", times=frames.times, values=values, names=view.agents)


class Failing(Heights):
    """Branches on an array."""

    def curve(self, name: str, view: Any, frames: Any) -> Any:
        return None if frames.values > np.inf else super().curve(name, view, frames)


class Orphan(Heights):
    """Does not call the inherited method."""

    def __init__(self, run_view: Any, detail: Any) -> None:
        self.seen = 0


class Wordless(Heights):
    """Has a legend of single words."""

    def legend(self) -> Any:
        yield "lines"


class Topicless(Heights):
    """Names a topic without a slash."""

    def topics(self) -> Any:
        return ["state"]


class Printing(Heights):
    """Declares an unknown output."""

    outputs: ClassVar[Any] = frozenset({"paper"})


BROKEN: dict[type[Drawing], tuple[str, ...]] = {
    Listing: ("Listing.marks", "draws a list, which is not a mark", "symaware_cli.drawings"),
    Rooted: ("Rooted.marks", "draws at '/curves', which is not a path"),
    Seconds: ("Seconds.marks", "whole numbers of nanoseconds"),
    Overwriting: ("Overwriting.marks", "changes the chunk that it was given"),
    Elsewhere: ("Elsewhere.marks", "at `curves/depths/robot`", "begin with `curves/heights/`"),
    Rolling: ("Rolling.marks (", "the global generator of Python"),
    Counting: ("Counting.marks", "other marks when the same log is drawn again"),
    Failing: ("Failing.marks (test_drawing_check.py, line", "branches on an array"),
    Orphan: ("Orphan.__init__ (", "does not call the inherited method"),
    Wordless: ("Wordless.legend (", "yields 'lines'", "the marks, and their meaning"),
    Topicless: ("Topicless.topics (", "names 'state'"),
    Printing: ("Printing (", "has outputs that are not a set of replay"),
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_drawing_is_named_with_the_method_and_a_correction(kind: type[Drawing]) -> None:
    said = deviations(check_drawing, kind)
    for words in BROKEN[kind]:
        assert words in said


def test_a_drawing_that_only_reads_conforms() -> None:
    check_drawing(Heights, {"agents.robot.count": 1})
