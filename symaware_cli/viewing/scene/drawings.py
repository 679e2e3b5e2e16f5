"""Declares what is drawn: of the world and of events for every backend, curves for replays, and those of plots."""

from __future__ import annotations

from symaware_cli.viewing.scene.bodies import Agents, Trails
from symaware_cli.viewing.scene.contacts import ContactPoints, Contacts
from symaware_cli.viewing.scene.curves import AwarenessCurves, RecordedNumbers, SeparationCurve
from symaware_cli.viewing.scene.figures import Appearances
from symaware_cli.viewing.scene.goals import Goals
from symaware_cli.viewing.scene.journal import Events, Knowledge
from symaware_cli.viewing.scene.messages import Informed, Messages
from symaware_cli.viewing.scene.others import BeliefsAboutOthers
from symaware_cli.viewing.scene.own_awareness import Intents, Uncertainties
from symaware_cli.viewing.scene.risk import RiskCurves
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.scene.scenery import RegionsDrawing, SceneryDrawing
from symaware_cli.viewing.scene.sensors import Cameras, Scans
from symaware_cli.viewing.scene.signals import Bars, Boxes, DeclaredLinks, SignalPoints
from symaware_cli.viewing.scene.specification_marks import (
    EverySpecificationCurve,
    SpecificationCurves,
    SpecificationTable,
    Violations,
)

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

#: The curves and tables of a replay in Rerun, besides the drawings of the world and of events.
CURVES: tuple[type[Drawing], ...] = (
    SpecificationCurves,
    SpecificationTable,
    RiskCurves,
    SeparationCurve,
    AwarenessCurves,
)

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
