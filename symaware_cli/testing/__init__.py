"""The conformance kit: checks that authors of plugins call in their own tests.

A test of a plugin is one line in any test framework::

    from symaware_cli.testing import assert_repeatable, check_component

    def test_my_component_conforms():
        check_component(Sway, sway=0.05)

    def test_my_scenario_can_be_repeated():
        assert_repeatable("scenarios/mine.yaml", overrides=["run.duration=2"])
"""

from symaware_cli.testing.component_check import check_component
from symaware_cli.testing.conformance import ConformanceError
from symaware_cli.testing.repeatability import assert_batchable, assert_conforming, assert_repeatable

__all__ = [
    "ConformanceError",
    "assert_batchable",
    "assert_conforming",
    "assert_repeatable",
    "check_component",
]
