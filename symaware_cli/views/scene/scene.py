"""Scenes, which convert a log to marks with all installed drawings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

from symaware_cli.entry_points import Listing
from symaware_cli.views.chunk import Chunk, ChunkReader
from symaware_cli.views.detail import Detail
from symaware_cli.views.scene.drawing import DRAWING, Drawing, Output
from symaware_cli.views.scene.marks import Mark, mark_fault
from symaware_cli.views.views import RunView
from symaware_cli.world import InstalledPlugins, code_position, describe

#: Fields of the true state of a group.
_TRUTHS = ("state", "control", "pose", "joints")

#: What a mark with wrong contents makes a backend raise.
_CONTENT_ERRORS = (ValueError, TypeError, IndexError, KeyError, AttributeError, ArithmeticError)


def installed_drawings(output: Output) -> Mapping[type[Drawing], Listing]:
    """Import the drawings for an output, in the order in which they draw; broken plugins are reported and left out."""
    found = [each for each in InstalledPlugins([DRAWING]).usable(DRAWING.name) if output in each[1].outputs]
    return {drawing: listing for listing, drawing in sorted(found, key=lambda each: (each[1].order, each[0].name))}


def scene_of(run_view: RunView, detail: Detail, output: Output) -> Scene:
    """Create the scene of all installed drawings for an output."""
    return Scene(run_view, detail, installed_drawings(output))


class Scene:
    """Converts a log to marks, chunk by chunk.

    A drawing of another package that fails is reported by a `PluginWarning`, and draws nothing from then on.

    Attributes:
        drawings: The drawings that did not fail.
    """

    def __init__(
        self,
        run_view: RunView,
        detail: Detail,
        drawings: Mapping[type[Drawing], Listing] | Sequence[type[Drawing]],
    ) -> None:
        """Create the drawings.

        Args:
            run_view: The run to draw.
            detail: The level of detail.
            drawings: The classes of drawings. Of those with listings that are not built in, failures are reported.
        """
        self._run_view = run_view
        listings = drawings if isinstance(drawings, Mapping) else {}
        self._plugins = {drawing: listing for drawing, listing in listings.items() if not listing.built_in}
        #: The drawing of each path.
        self._owners: dict[str, Drawing] = {}
        self.drawings: list[Drawing] = []
        for drawing in drawings:
            if drawing not in self._plugins:
                self.drawings.append(drawing(run_view, detail))
                continue
            try:
                self.drawings.append(drawing(run_view, detail))
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                self._plugins[drawing].warn(_failure(error))

    def chunk_reader(self) -> ChunkReader:
        """Create a reader that groups messages into chunks for this scene."""
        counts = {
            topic: len(group_view.agents)
            for group_view in self._run_view.group_views.values()
            for topic in (
                *(f"/world/{group_view.name}/{field}" for field in _TRUTHS),
                f"/agents/{group_view.name}/control",
                *map(group_view.topic, group_view.signals),
            )
        }
        return ChunkReader(counts, self._run_view.place)

    def marks(self, chunk: Chunk) -> Iterator[Mark]:
        """Yield the marks of a chunk; chunks must be ordered by time."""
        for drawing in tuple(self.drawings):
            yield from self._drawn(drawing, chunk)

    def draw(self, chunk: Chunk, show: Callable[[Mark], object]) -> None:
        """Show the marks of a chunk; chunks must be ordered by time.

        Args:
            chunk: The chunk.
            show: Shows a mark.
        """
        for drawing in tuple(self.drawings):
            for mark in self._drawn(drawing, chunk):
                try:
                    show(mark)
                except _CONTENT_ERRORS as error:
                    if type(drawing) not in self._plugins:
                        raise
                    self._leave_out(drawing, _failure(error))
                    break

    def topics(self, panels: Collection[str]) -> list[str]:
        """Return the topics that a plot has to read for its drawings.

        Args:
            panels: The panels of drawings that are plotted; the empty name is for drawings without a panel.
        """
        found: list[str] = []
        for drawing in tuple(self.drawings):
            try:
                found += drawing.topics() if drawing.panel in panels else ()
            except _CONTENT_ERRORS as error:
                if type(drawing) not in self._plugins:
                    raise
                self._leave_out(drawing, _failure(error))
        return found

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        for drawing in tuple(self.drawings):
            try:
                yield from list(drawing.legend())
            except _CONTENT_ERRORS as error:
                if type(drawing) not in self._plugins:
                    raise
                self._leave_out(drawing, _failure(error))

    def _drawn(self, drawing: Drawing, chunk: Chunk) -> Iterable[Mark]:
        """Return the marks of a drawing; none if it is of another package and fails."""
        if type(drawing) not in self._plugins:
            return self._claimed(drawing, drawing.marks(chunk))
        if drawing not in self.drawings:
            return ()  # left out for what another one draws in this chunk
        try:
            found = list(drawing.marks(chunk))
            fault = next(filter(None, (mark_fault(mark) or self._taken(mark.path, drawing) for mark in found)), None)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            fault = _failure(error)
        if fault is None:
            return found
        self._leave_out(drawing, fault)
        return ()

    def _claimed(self, drawing: Drawing, found: Iterable[Mark]) -> Iterator[Mark]:
        """Yield the marks of a drawing of this package, whose paths belong to it."""
        for mark in found:
            other = self._owners.get(mark.path)
            if other is not None and type(other) in self._plugins:
                self._leave_out(other, f"draws at `{mark.path}`, a path of {type(drawing).__name__}")
            self._owners[mark.path] = drawing
            yield mark

    def _taken(self, path: str, drawing: Drawing) -> str | None:
        """Return that a path belongs to another drawing, as a predicate; None if it does not."""
        owner = self._owners.setdefault(path, drawing)
        return None if owner is drawing else f"draws at `{path}`, a path of {type(owner).__name__}"

    def _leave_out(self, drawing: Drawing, problem: str) -> None:
        if drawing in self.drawings:
            self.drawings.remove(drawing)
            self._plugins[type(drawing)].warn(problem)


def _failure(error: BaseException) -> str:
    return f"fails: {describe(error)}{code_position(error, beyond=__file__)}"
