"""Trajectories of selected runs of a sweep, which are repeated to record them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Event
from symaware_cli.engine import Simulation
from symaware_cli.log import LogError, open_log
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.row import Row
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_files import JOURNAL
from symaware_cli.studies.sweep_journal import SweepJournal
from symaware_cli.studies.sweep_plan import Cell, SweepPlan, brief_names
from symaware_cli.views import PlotRequest, Trajectories, gather

Array = NDArray[np.float64]

#: The minimum number of points of a path, if the run has as many steps; the maximum is just below twice this.
_POINTS = 80


class RunPaths:
    """Records a bounded number of positions of each agent during runs, single or in batches.

    Attributes:
        goals_differ: Whether the knowledge of the agents, and possibly their goals, differs between runs.
    """

    def __init__(self) -> None:
        self.goals_differ = False
        self._known: list[str] | None = None
        self._of: dict[int, tuple[_Followed, int]] = {}

    def follow(self, indices: Sequence[int], simulation: Simulation) -> None:
        """Attach to runs that are about to begin.

        Args:
            indices: Their numbers, in the order of their rows.
            simulation: The simulation.
        """
        followed = _Followed(simulation, len(indices))
        for place, index in enumerate(indices):
            self._of[index] = (followed, place)
            known = [
                repr(each) for group in simulation.groups for each in group.knowledge[_rows(group, len(indices), place)]
            ]
            self._known = self._known or known
            self.goals_differ = self.goals_differ or known != self._known

    def take(self, index: int) -> Array:
        """Return the positions (k, n, 2) of the agents of a finished run [m]; NaN while an agent is absent."""
        followed, place = self._of.pop(index)
        return followed.positions(place)


class _Followed:
    """The recorded runs of one simulation."""

    def __init__(self, simulation: Simulation, runs: int) -> None:
        self._simulation = simulation
        self._runs = runs
        self._stride = 1
        self._step = 0
        self._sampled: list[list[Array]] = []
        self._last: list[Array] = []
        simulation.events.subscribe("stepping", self._on_stepping)
        simulation.events.subscribe("stepped", self._on_stepped)

    def positions(self, place: int) -> Array:
        """Return the positions (k, n, 2) of the agents of one of the runs [m]."""
        instants = [*self._sampled, *([self._last] if self._last else [])]
        groups = self._simulation.groups
        parts = [
            np.stack([instant[number][_rows(group, self._runs, place)] for instant in instants])
            for number, group in enumerate(groups)
        ]
        found: Array = np.concatenate(parts, axis=1)
        return found

    def _on_stepping(self, event: Event) -> None:
        if self._step % self._stride == 0:
            self._sampled.append([self._positions(group) for group in self._simulation.groups])
            if len(self._sampled) == 2 * _POINTS:
                self._sampled = self._sampled[::2]
                self._stride *= 2
        self._step += 1

    def _on_stepped(self, event: Event) -> None:
        self._last = [self._positions(group) for group in self._simulation.groups]

    def _positions(self, group: AgentGroup) -> Array:
        positions = group.model.positions(self._simulation.environment.state(group))[:, :2].copy()
        if group.present is not None:
            positions[~group.present] = np.nan
        return positions


def _rows(group: AgentGroup, runs: int, place: int) -> slice:
    """Return the rows of a group that belong to one of the runs in it."""
    share = len(group) // runs
    return slice(place * share, (place + 1) * share)


#: The maximum number of panels, and the default number of runs repeated for all of them together.
_MOST, _USUAL = 12, 1000


@dataclass(frozen=True, slots=True)
class PathsPanel:
    """The trajectories of one combination of parameters, in one variant.

    Attributes:
        caption: The values of the combination; empty if it is the only one.
        surroundings: The surroundings: regions, obstacles, goals.
        paths: The positions (k, n, 2) of the agents in each run [m]; NaN while an agent is absent.
        violated: Whether each run violated a specification.
        goals_differ: Whether goals may differ between runs, so that none are drawn.
    """

    caption: str
    surroundings: Trajectories
    paths: Sequence[Array]
    violated: Sequence[bool]
    goals_differ: bool


@dataclass(frozen=True, slots=True)
class PathsPicture:
    """The content of a picture of trajectories.

    Attributes:
        name: The name of the sweep.
        seed: Its seed.
        specifications: The names of its specifications.
        panels: Its panels.
        notes: The lines of text below the panels.
    """

    name: str
    seed: int
    specifications: Sequence[str]
    panels: Sequence[PathsPanel]
    notes: Sequence[str]

    @property
    def runs(self) -> int:
        """The number of runs drawn."""
        return sum(len(panel.paths) for panel in self.panels)


def gathered(
    folder: SweepFolder, count: int | None = None, on_progress: Callable[[int, int], object] | None = None
) -> PathsPicture:
    """Repeat runs, and record the paths of their agents.

    The first runs of each combination are drawn regardless of their outcome, so that shares are not biased.

    Args:
        folder: The sweep, which need not be finished.
        count: The maximum number of runs per combination; None for 1,000 in total.
        on_progress: Called after each run with the number of completed runs and the total.

    Raises:
        LogError: There are no runs, or they recorded no positions.
        SweepError: A repeated run differs from the original.
    """
    plan = folder.plan
    numbers = np.unique(np.linspace(0, len(plan.cells) - 1, min(_MOST, len(plan.cells))).round().astype(int))
    cells = [plan.cells[number] for number in numbers]
    chosen = _first_done(folder, cells, count or max(1, _USUAL // len(cells)))
    total, made = sum(map(len, chosen)), 0
    if not total:
        raise LogError("there are no runs to draw: none has ended")
    panels = []
    for cell, rows in zip(cells, chosen, strict=True):
        if not rows:
            continue
        surroundings = _surroundings(folder, rows[0])
        following = RunPaths()
        before, paths = {row.index: row for row in rows}, dict[int, Array]()
        for row in folder.runner(follow=following.follow).rows(list(before)):
            _require_equal(folder, before[row.index], row)
            paths[row.index] = following.take(row.index)
            made += 1
            if on_progress is not None:
                on_progress(made, total)
        violated = ["violated" in row.verdicts.values() for row in rows]
        caption = _caption(cell, plan)
        panels.append(
            PathsPanel(caption, surroundings, [paths[index] for index in before], violated, following.goals_differ)
        )
    notes = tuple(_notes(folder, panels, len(plan.cells), total))
    return PathsPicture(folder.path.resolve().name, plan.document.seed, folder.specifications, panels, notes)


def _first_done(folder: SweepFolder, cells: Sequence[Cell], count: int) -> list[list[Row]]:
    """Return the first runs of each cell that are done."""
    found: dict[int, list[Row]] = {cell.number: [] for cell in cells}
    missing = len(found) * count
    with SweepJournal(folder.path / JOURNAL) as journal:
        for row in journal.rows("done"):
            own = found.get(row.index % len(folder.plan.cells))
            if own is not None and len(own) < count:
                own.append(row)
                missing -= 1
                if not missing:
                    break
    return list(found.values())


def _surroundings(folder: SweepFolder, row: Row) -> Trajectories:
    """Return the content of the map from the log of a run."""
    with tempfile.TemporaryDirectory() as temporary:
        logged = folder.runner().run(row.index, Path(temporary))
        _require_equal(folder, row, logged)
        assert logged.log is not None
        content = gather(open_log(Path(temporary, logged.log)), PlotRequest(show=("trajectories",)))
    (panel,) = content.panels
    assert isinstance(panel, Trajectories)
    return panel


def _require_equal(folder: SweepFolder, before: Row, again: Row) -> None:
    if before.digest != again.digest:
        folder.check()  # names the version that differs, if one does
        raise SweepError(f"run {before.index} of {folder.path} had another result when it was repeated")


def _caption(cell: Cell, plan: SweepPlan) -> str:
    varying = [path for path in cell.parameters if len({repr(each.parameters[path]) for each in plan.cells}) > 1]
    values = [f"{name} = {cell.parameters[path]}" for name, path in zip(brief_names(varying), varying, strict=True)]
    return ", ".join([*([] if cell.variant is None else [cell.variant]), *values])


def _notes(folder: SweepFolder, panels: Sequence[PathsPanel], cells: int, drawn: int) -> Iterator[str]:
    if folder.specifications and any(any(panel.violated) for panel in panels):
        yield f"Red: runs in which a specification is violated ({', '.join(folder.specifications)})."
    planned = folder.plan.document.runs * len(panels)
    if drawn < planned:
        of_each = "" if cells == 1 else " of each combination"
        yield f"The first runs{of_each}: {drawn:,} of {planned:,}."
    if len(panels) < cells:
        yield f"{len(panels)} of {cells:,} combinations."
    if folder.plan.document.drawn:
        yield "Regions and obstacles are those of the first run, though parameters are drawn for each."
    if any(panel.surroundings.spatial for panel in panels):
        yield "Seen from above."
    if any(panel.goals_differ for panel in panels):
        yield "Goals are not shown, since they may differ from run to run."
