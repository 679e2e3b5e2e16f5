"""SymAware: declarative scenarios for multi-agent systems with situational awareness.

The names in ``__all__`` are the public API, for running scenarios from Python (docs/python.md) and for authors of
plugins (docs/plugins.md). Everything else may change.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from symaware_cli import processor
from symaware_cli.version import __version__ as __version__

# Before anything imports NumPy, which looks at the processor once.
processor.pin()

if TYPE_CHECKING:
    from symaware_cli.abstraction.bisimulation import Bisimulation, bisimulation
    from symaware_cli.abstraction.knowledge_model import KnowledgeModel
    from symaware_cli.abstraction.transition_system import TransitionSystem
    from symaware_cli.api.branch_changes import BranchError
    from symaware_cli.api.branching import BranchResult, branch, branches
    from symaware_cli.api.certification import (
        Certificate,
        CertificateVerification,
        certify,
        verify_certificate,
    )
    from symaware_cli.api.checking import CheckResult, check_log
    from symaware_cli.api.comparison import ComparisonResult, compare
    from symaware_cli.api.falsifying import Falsification, falsify
    from symaware_cli.api.html_report import write_report
    from symaware_cli.api.rare_events import RareEventEstimate, estimate
    from symaware_cli.api.result import RunFailedError, RunInterrupted, RunResult
    from symaware_cli.api.scenario import GroupOutline, Outline, Scenario, load
    from symaware_cli.api.stepping import SteppedSimulation
    from symaware_cli.api.sweep_comparison import SweepComparison, compare_sweeps
    from symaware_cli.api.sweep_verification import SweepVerification
    from symaware_cli.api.sweeps import sweep, verify_sweep
    from symaware_cli.api.verification import VerificationResult, verify_log
    from symaware_cli.components.sensor import Sensor, SensorParameters
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
        EntityGroup,
        Environment,
        EnvironmentParameters,
        Event,
        GroupCommunicationReceiver,
        GroupComponent,
        KnowledgeDatabase,
        Level,
        Links,
        Mesh,
        Message,
        MessageBatch,
        Metric,
        Model,
        Observation,
        Obstacle,
        Parameters,
        Part,
        PerceptionSystem,
        Polygon,
        Quantity,
        RiskEstimator,
        Roster,
        Scenery,
        ScriptedPath,
        Shape,
        Signal,
        Snapshot,
        TimeSeries,
        Tracks,
        Turn,
        UncertaintyEstimator,
        Urdf,
        Wall,
        WorldError,
        generator,
        nanoseconds,
        seconds,
    )
    from symaware_cli.core.stateful import StateError
    from symaware_cli.core.verdict import SpecificationStatus
    from symaware_cli.distributed.transport import Port, PortEvent, Transport, TransportError, TransportParameters
    from symaware_cli.environments.vehicle import Vehicle
    from symaware_cli.network.topology.topology import Topology, TopologyError, TopologyParameters
    from symaware_cli.processor import ProcessorWarning
    from symaware_cli.recording.error import LogError
    from symaware_cli.recording.reader import Log, open_log
    from symaware_cli.recording.series import Series
    from symaware_cli.runtime.state.simulation_state import SimulationState
    from symaware_cli.scenario.place import DistributionError, Place
    from symaware_cli.scenario.problem import ScenarioError
    from symaware_cli.study.sweep_error import SweepError

__all__ = [
    "Agent",
    "AgentGroup",
    "AwarenessDatabase",
    "AwarenessVector",
    "Bisimulation",
    "Box",
    "BranchError",
    "BranchResult",
    "Certificate",
    "CertificateVerification",
    "CheckResult",
    "Circle",
    "CommunicationReceiver",
    "CommunicationSender",
    "ComparisonResult",
    "Component",
    "Contact",
    "Controller",
    "Cylinder",
    "Delivery",
    "DistributionError",
    "Entity",
    "EntityGroup",
    "Environment",
    "EnvironmentParameters",
    "Event",
    "Falsification",
    "GroupCommunicationReceiver",
    "GroupComponent",
    "GroupOutline",
    "KnowledgeDatabase",
    "KnowledgeModel",
    "Level",
    "Links",
    "Log",
    "LogError",
    "Mesh",
    "Message",
    "MessageBatch",
    "Metric",
    "Model",
    "Observation",
    "Obstacle",
    "Outline",
    "Parameters",
    "Part",
    "PerceptionSystem",
    "Place",
    "Polygon",
    "Port",
    "PortEvent",
    "ProcessorWarning",
    "Quantity",
    "RareEventEstimate",
    "RiskEstimator",
    "Roster",
    "RunFailedError",
    "RunInterrupted",
    "RunResult",
    "Scenario",
    "ScenarioError",
    "Scenery",
    "ScriptedPath",
    "Sensor",
    "SensorParameters",
    "Series",
    "Shape",
    "Signal",
    "SimulationState",
    "Snapshot",
    "SpecificationStatus",
    "StateError",
    "SteppedSimulation",
    "SweepComparison",
    "SweepError",
    "SweepVerification",
    "TimeSeries",
    "Topology",
    "TopologyError",
    "TopologyParameters",
    "Tracks",
    "TransitionSystem",
    "Transport",
    "TransportError",
    "TransportParameters",
    "Turn",
    "UncertaintyEstimator",
    "Urdf",
    "Vehicle",
    "VerificationResult",
    "Wall",
    "WorldError",
    "bisimulation",
    "branch",
    "branches",
    "certify",
    "check_log",
    "compare",
    "compare_sweeps",
    "estimate",
    "falsify",
    "generator",
    "load",
    "nanoseconds",
    "open_log",
    "seconds",
    "sweep",
    "verify_certificate",
    "verify_log",
    "verify_sweep",
    "write_report",
]


#: The module that defines each public name that `symaware_cli.core` does not provide.
_HOMES = {
    "symaware_cli.abstraction.bisimulation": ("Bisimulation", "bisimulation"),
    "symaware_cli.abstraction.knowledge_model": ("KnowledgeModel",),
    "symaware_cli.abstraction.transition_system": ("TransitionSystem",),
    "symaware_cli.api.certification": ("Certificate", "CertificateVerification", "certify", "verify_certificate"),
    "symaware_cli.api.falsifying": ("Falsification", "falsify"),
    "symaware_cli.api.rare_events": ("RareEventEstimate", "estimate"),
    "symaware_cli.api.html_report": ("write_report",),
    "symaware_cli.api.branch_changes": ("BranchError",),
    "symaware_cli.api.branching": ("BranchResult", "branch", "branches"),
    "symaware_cli.api.result": ("RunFailedError", "RunInterrupted", "RunResult"),
    "symaware_cli.api.scenario": ("GroupOutline", "Outline", "Scenario", "load"),
    "symaware_cli.api.stepping": ("SteppedSimulation",),
    "symaware_cli.api.sweep_comparison": ("SweepComparison", "compare_sweeps"),
    "symaware_cli.api.sweep_verification": ("SweepVerification",),
    "symaware_cli.api.sweeps": ("sweep", "verify_sweep"),
    "symaware_cli.api.verification": ("VerificationResult", "verify_log"),
    "symaware_cli.components.sensor": ("Sensor", "SensorParameters"),
    "symaware_cli.core.stateful": ("StateError",),
    "symaware_cli.core.verdict": ("SpecificationStatus",),
    "symaware_cli.environments.vehicle": ("Vehicle",),
    "symaware_cli.network.topology.topology": ("Topology", "TopologyError", "TopologyParameters"),
    "symaware_cli.distributed.transport": (
        "Port",
        "PortEvent",
        "Transport",
        "TransportError",
        "TransportParameters",
    ),
    "symaware_cli.processor": ("ProcessorWarning",),
    "symaware_cli.recording.error": ("LogError",),
    "symaware_cli.api.checking": ("CheckResult", "check_log"),
    "symaware_cli.api.comparison": ("ComparisonResult", "compare"),
    "symaware_cli.recording.reader": ("Log", "open_log"),
    "symaware_cli.recording.series": ("Series",),
    "symaware_cli.runtime.state.simulation_state": ("SimulationState",),
    "symaware_cli.scenario.place": ("DistributionError", "Place"),
    "symaware_cli.scenario.problem": ("ScenarioError",),
    "symaware_cli.study.sweep_error": ("SweepError",),
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that the command line starts without NumPy."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = next((home for home, names in _HOMES.items() if name in names), "symaware_cli.core")
    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
