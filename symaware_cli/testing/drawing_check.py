"""Checks of drawings: topics, legends, marks and their times, and chunks that are not changed."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from symaware_cli.language import prepared
from symaware_cli.log import open_log
from symaware_cli.testing.conformance import DeviationList, require_kind
from symaware_cli.testing.side_effects import fingerprint, watched
from symaware_cli.testing.small_scenario import Changes, SmallScenario, scenario
from symaware_cli.views import DRAWING, Drawing, Scene, detail_of, mark_fault, run_view_of

#: Messages in a chunk: few, so that there are several chunks.
_FEW = 40


def check_drawing(kind: type[Drawing], changes: Changes | None = None, /) -> None:
    """Check a drawing of the log of three agents with eight steps, which is read in several chunks.

    Topics must be paths; marks must be of the class `Mark`, at ascending times within the run, and equal when the log
    is drawn again; and chunks must not be changed.

    Args:
        kind: The class.
        changes: Values of the scenario by their paths, such as further components that record the data of the drawing.

    Raises:
        ConformanceError: A line for each deviation.
    """
    found = require_kind(kind, DRAWING)
    small = SmallScenario(scenario(), changes, found)
    small.is_named = False
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "conformance.mcap"
        with prepared(small.build(), path, may_exit=False) as run:
            run.advance()
        first = _draw(found, path)
        found.settle()
        second = _draw(found, path)
    if first != second:
        found.add("marks", "draws other marks when the same log is drawn again", "keep nothing outside of the object")
    found.settle()


def _draw(found: DeviationList, path: Path) -> list[str]:
    """Draw a log; return fingerprints of the marks."""
    log = open_log(path)
    view = run_view_of(log)
    kind: Any = found.kind
    with found.calling("__init__"):
        drawing = kind(view, detail_of(view))
    if found:
        return []
    if not isinstance(getattr(drawing, "run_view", None), type(view)):
        found.add("__init__", "does not call the inherited method", "begin with `super().__init__(run_view, detail)`")
        return []
    with found.calling("topics"):
        for topic in drawing.topics():
            if not isinstance(topic, str) or not topic.startswith("/"):
                found.add("topics", f"names {topic!r}", "give paths like `view.state_topic`: /world/robot/state")
    with found.calling("legend"):
        for each in drawing.legend():
            if not isinstance(each, tuple) or [type(part) for part in each] != [str, str]:
                found.add("legend", f"yields {each!r}", "yield pairs: the marks, and their meaning")
    marks = []
    for chunk in Scene(view, detail_of(view), [kind]).chunk_reader().chunks(log.messages(), _FEW):
        before = fingerprint(chunk)
        with found.calling("marks"), watched(found, "marks"):
            for mark in drawing.marks(chunk):
                fault = mark_fault(mark)
                if fault is not None:
                    found.add("marks", fault, "see the kinds of marks in `symaware_cli.drawings`")
                    continue
                if drawing.panel and mark.path.startswith("curves/"):
                    _check_panel(found, drawing.panel, mark.path)
                marks.append(fingerprint(mark))
        if fingerprint(chunk) != before:
            found.add("marks", "changes the chunk that it was given", "compute new arrays: others draw it, too")
        if found:
            return []
    return marks


def _check_panel(found: DeviationList, panel: str, path: str) -> None:
    if not path.startswith(f"curves/{panel}/"):
        found.add("marks", f"draws curves at `{path}`", f"begin with `curves/{panel}/`, as `panel` says")
