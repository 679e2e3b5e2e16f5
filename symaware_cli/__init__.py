"""SymAware: declarative scenarios for multi-agent systems with situational awareness.

What stands in ``__all__`` is the public API for authors of plugins; all else may change.
"""

from typing import TYPE_CHECKING, Any

from symaware_cli import processor

__version__ = "0.1.0"

# Before anything imports NumPy, which looks at the processor once.
processor.pin()

if TYPE_CHECKING:
    from symaware_cli.core import (
        Agent,
        AgentGroup,
        AwarenessDatabase,
        AwarenessVector,
        Box,
        Circle,
        CommunicationReceiver,
        CommunicationSender,
        Component,
        Contact,
        Controller,
        Cylinder,
        Delivery,
        Entity,
        Environment,
        EnvironmentParameters,
        Event,
        GroupCommunicationReceiver,
        GroupComponent,
        Happening,
        KnowledgeDatabase,
        Level,
        Links,
        Mesh,
        Message,
        MessageBatch,
        Model,
        Observation,
        Obstacle,
        Parameters,
        PerceptionSystem,
        Polygon,
        Port,
        Quantity,
        RiskEstimator,
        Roster,
        Scenery,
        ScriptedPath,
        Shape,
        Snapshot,
        TimeSeries,
        Topology,
        TopologyError,
        TopologyParameters,
        Tracks,
        Transport,
        TransportError,
        TransportParameters,
        UncertaintyEstimator,
        Urdf,
        Vehicle,
        Wall,
        WorldError,
        nanoseconds,
        seconds,
    )
    from symaware_cli.recording.reader import open_log

__all__ = [
    "Agent",
    "AgentGroup",
    "AwarenessDatabase",
    "AwarenessVector",
    "Box",
    "Circle",
    "CommunicationReceiver",
    "CommunicationSender",
    "Component",
    "Contact",
    "Controller",
    "Cylinder",
    "Delivery",
    "Entity",
    "Environment",
    "EnvironmentParameters",
    "Event",
    "GroupCommunicationReceiver",
    "GroupComponent",
    "Happening",
    "KnowledgeDatabase",
    "Level",
    "Links",
    "Mesh",
    "Message",
    "MessageBatch",
    "Model",
    "Observation",
    "Obstacle",
    "Parameters",
    "PerceptionSystem",
    "Polygon",
    "Port",
    "Quantity",
    "RiskEstimator",
    "Roster",
    "Scenery",
    "ScriptedPath",
    "Shape",
    "Snapshot",
    "TimeSeries",
    "Topology",
    "TopologyError",
    "TopologyParameters",
    "Tracks",
    "Transport",
    "TransportError",
    "TransportParameters",
    "UncertaintyEstimator",
    "Urdf",
    "Vehicle",
    "Wall",
    "WorldError",
    "nanoseconds",
    "open_log",
    "seconds",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for, so that the command line starts without NumPy."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "open_log":
        from symaware_cli.recording import reader as home
    else:
        from symaware_cli import core as home  # type: ignore[no-redef]
    return getattr(home, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
