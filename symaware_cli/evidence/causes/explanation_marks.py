"""The causes of a violation in replays, from the explanation beside the log.

Reasons: docs/decisions/0107-components-as-causes.md
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from symaware_cli.core import nanoseconds
from symaware_cli.evidence.causes.explanation_file import (
    ExplanationFile,
    NamedCandidate,
    beside,
    read_explanation,
)
from symaware_cli.log import open_log
from symaware_cli.views import RISK, Chunk, Detail, Drawing, Journal, Lines, Rings, RunView

#: Radius of the ring around the agent of a cause, in radii of the body.
_REACH = 2.6

#: The most causes that are drawn.
_MOST = 8


class Causes(Drawing):
    """Draws the causes of an explanation, and writes its rows into the text log at their instants.

    A cause between two agents is a line between them, and one of a single agent a ring around it, from the earliest
    instant at which it was established until the violation.
    """

    outputs: ClassVar = frozenset({"replay", "foxglove"})
    order: ClassVar = 195

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._found: ExplanationFile | None = None
        self._lines: list[tuple[int, str, str, str]] = []
        if run_view.path is None or not beside(run_view.path).is_file():
            return
        found = read_explanation(beside(run_view.path), open_log(run_view.path))
        if isinstance(found, str):
            self._lines = [(0, "warning", beside(run_view.path).name, found)]
            return
        self._found = found
        self._lines = sorted(_lines(found), key=lambda each: each[0])

    def marks(self, chunk: Chunk) -> Iterator[Journal | Lines | Rings]:
        """Yield the rows of the explanation of these instants, and the marks of its causes."""
        # The first chunk has what was before it, and the last instant of a chunk may be the first of the next.
        told = [each for each in self._lines if each[0] <= chunk.end]
        self._lines = self._lines[len(told) :]
        if told:
            times, kinds, sources, texts = zip(*told, strict=True)
            yield Journal(
                path="log/events/explanation",
                layer="events",
                times=np.array(times, np.int64),
                kinds=kinds,
                sources=sources,
                texts=texts,
                levels=["WARNING" if each == "warning" else "INFO" for each in kinds],
            )
        if self._found is None:
            return
        for number, (each, begin) in enumerate(_causes(self._found)[:_MOST]):
            span = nanoseconds(begin), nanoseconds(self._found.violated)
            yield from self._drawn(f"world/causes/{number}", each, span, chunk)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        if self._found is not None and _causes(self._found):
            yield "thick red lines and rings", "causes of the violation, from the time at which they matter"

    def _drawn(self, path: str, given: NamedCandidate, span: tuple[int, int], chunk: Chunk) -> Iterator[Lines | Rings]:
        """Yield the marks of a cause from its first instant to the violation [ns]."""
        of = (given.of or "").rpartition(".")[0] if given.kind == "component" else given.of
        named = (given.agent or given.sender or of or "", given.about or given.receiver or "")
        ends = [each for each in dict.fromkeys(named) if each in self.run_view.place]
        if not ends:
            return
        group_view = self.run_view.group_views[self.run_view.place[ends[0]][0]]
        frames = chunk.frames.get(group_view.state_topic)
        if frames is None:
            return
        times = frames.times[frames.times >= span[0]]
        if not len(times):
            return
        shown = times <= span[1]
        places = [self.places(each, times[shown], chunk) for each in ends]
        count = int(shown.sum())
        if len(ends) == 2:
            yield Lines(
                path=path,
                layer="causes",
                times=times,
                counts=shown.astype(np.int64),
                colours=np.array(RISK, np.uint8),
                transparency=0.3,
                points=np.stack(places, axis=1).reshape(-1, 3),
                lengths=np.full(count, 2),
                width=5.0,
            )
        else:
            yield Rings(
                path=path,
                layer="causes",
                times=times,
                counts=shown.astype(np.int64),
                colours=np.array(RISK, np.uint8),
                centres=places[0],
                radii=np.full(count, _REACH * (group_view.extent or 0.1)),
                width=4.0,
            )


def _causes(found: ExplanationFile) -> list[tuple[NamedCandidate, float]]:
    """The causes, single ones or those that matter together, with the earliest instant of each [s]."""
    causes = [
        (each.candidate, min(test.at for test in each.in_general if test.established))
        for each in found.candidates
        if each.cause
    ]
    together = found.together
    return causes + ([] if together is None else [(each, together.in_general.at) for each in together.candidates])


def _lines(found: ExplanationFile) -> Iterator[tuple[int, str, str, str]]:
    """Yield a line for each candidate and instant that was tried: the time [ns], its kind, the candidate, its text."""
    for row in found.candidates:
        general = {each.at: each for each in row.in_general}
        for each in row.in_this_run:
            said = f"{'saves' if each.saved else 'does not save'} this run"
            test = general.get(each.at)
            if test is not None and test.saved_by_placebo is not None:
                said += f", {test.saved_by_truth} of {test.futures} futures (placebo {test.saved_by_placebo})"
            kind = "cause" if test is not None and test.established else "candidate"
            yield nanoseconds(each.at), kind, row.candidate.text, said
