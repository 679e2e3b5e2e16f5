"""The conformance kit: checks that authors of plugins call in their own tests.

A test of a plugin is one line in any test framework::

    from symaware_cli.testing import assert_repeatable, check_component

    def test_my_component_conforms():
        check_component(Sway, sway=0.05)

    def test_my_scenario_can_be_repeated():
        assert_repeatable("scenarios/mine.yaml", overrides=["run.duration=2"])
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from symaware_cli.testing.component_check import check_component
    from symaware_cli.testing.conformance import ConformanceError
    from symaware_cli.testing.drawing_check import check_drawing
    from symaware_cli.testing.entry_point_check import check_entry_points
    from symaware_cli.testing.environment_check import check_environment
    from symaware_cli.testing.fault_check import check_fault
    from symaware_cli.testing.metric_check import check_metric
    from symaware_cli.testing.model_check import check_model
    from symaware_cli.testing.repeatability import assert_batchable, assert_conforming, assert_repeatable
    from symaware_cli.testing.topology_check import check_topology
    from symaware_cli.testing.transport_check import check_transport

__all__ = [
    "ConformanceError",
    "assert_batchable",
    "assert_conforming",
    "assert_repeatable",
    "check_component",
    "check_drawing",
    "check_entry_points",
    "check_environment",
    "check_fault",
    "check_metric",
    "check_model",
    "check_topology",
    "check_transport",
]

_HOMES = {
    "component_check": ("check_component",),
    "conformance": ("ConformanceError",),
    "drawing_check": ("check_drawing",),
    "entry_point_check": ("check_entry_points",),
    "environment_check": ("check_environment",),
    "fault_check": ("check_fault",),
    "metric_check": ("check_metric",),
    "model_check": ("check_model",),
    "repeatability": ("assert_batchable", "assert_conforming", "assert_repeatable"),
    "topology_check": ("check_topology",),
    "transport_check": ("check_transport",),
}


def __getattr__(name: str) -> Any:
    """Import a name on first use, so that each check imports only what it needs."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{home}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
