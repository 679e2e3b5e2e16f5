"""The scene: converts a log to marks, with the list of all drawings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from symaware_cli.viewing.chunk import Chunk, ChunkReader
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.scene.bars import Bars
from symaware_cli.viewing.scene.base import Drawing
from symaware_cli.viewing.scene.bodies import Agents
from symaware_cli.viewing.scene.boxes import Boxes
from symaware_cli.viewing.scene.contacts import ContactPoints, Contacts
from symaware_cli.viewing.scene.curves import AwarenessCurves, NumberTables, RecordedNumbers, SeparationCurve
from symaware_cli.viewing.scene.declared_links import DeclaredLinks
from symaware_cli.viewing.scene.figures import Appearances
from symaware_cli.viewing.scene.goals import Goals
from symaware_cli.viewing.scene.informed import Informed
from symaware_cli.viewing.scene.intents import Intents
from symaware_cli.viewing.scene.journal import Events, Knowledge
from symaware_cli.viewing.scene.marks import Mark
from symaware_cli.viewing.scene.messages import Messages
from symaware_cli.viewing.scene.others import BeliefsAboutOthers
from symaware_cli.viewing.scene.points import SignalPoints
from symaware_cli.viewing.scene.regions_drawing import RegionsDrawing
from symaware_cli.viewing.scene.risk import RiskCurves
from symaware_cli.viewing.scene.scenery import SceneryDrawing
from symaware_cli.viewing.scene.sensors import Cameras, Scans
from symaware_cli.viewing.scene.specification_curves import EverySpecificationCurve, SpecificationCurves, Violations
from symaware_cli.viewing.scene.specification_table import SpecificationTable
from symaware_cli.viewing.scene.trails import Trails
from symaware_cli.viewing.scene.uncertainties import Uncertainties
from symaware_cli.viewing.views import RunView

#: The drawings of the world and of events.
SCENE: tuple[type[Drawing], ...] = (
    SceneryDrawing,
    RegionsDrawing,
    Appearances,
    Goals,
    Agents,
    Trails,
    Intents,
    Uncertainties,
    BeliefsAboutOthers,
    DeclaredLinks,
    Bars,
    SignalPoints,
    Boxes,
    Scans,
    Cameras,
    Messages,
    Informed,
    Contacts,
    Violations,
    Events,
    Knowledge,
)
#: Curves of selected quantities, and tables from which users choose what to plot.
CURVES: tuple[type[Drawing], ...] = (
    SpecificationCurves,
    SpecificationTable,
    RiskCurves,
    SeparationCurve,
    AwarenessCurves,
)
TABLES: tuple[type[Drawing], ...] = (NumberTables,)
#: The drawings for plots of a whole run.
PLOTTED: tuple[type[Drawing], ...] = (
    SceneryDrawing,
    RegionsDrawing,
    Goals,
    Agents,
    Intents,
    ContactPoints,
    EverySpecificationCurve,
    RecordedNumbers,
)


class Scene:
    """Converts a log to marks, chunk by chunk."""

    def __init__(self, run_view: RunView, detail: Detail, drawings: Sequence[type[Drawing]] = SCENE) -> None:
        """Create the drawings.

        Args:
            run_view: The run to draw.
            detail: The level of detail.
            drawings: The classes of drawings.
        """
        self._run_view = run_view
        self._drawings = [drawing(run_view, detail) for drawing in drawings]

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
        for drawing in self._drawings:
            yield from drawing.marks(chunk)


#: Fields of the true state of a group.
_TRUTHS = ("state", "control", "pose", "joints")
