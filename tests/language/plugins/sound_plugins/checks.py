"""Plugins of several kinds that refuse scenarios without a component that they need."""

from typing import Any

from pydantic import Field

from sound_plugins.components import Plain
from sound_plugins.models import Line
from symaware_cli import Parameters, ScenarioView, TopologyParameters
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.network.topology.fixed import Complete
from symaware_cli.knowledge.abstraction.grid_cells import GridCells


class Need(Parameters):
    """The required component, and how its absence is reported."""

    needs: str = Field("robot.steer", description="A component of the scenario, as `group.name`.")
    told: str = Field("report", description="report, unknown, raise, fail or warn.")


class Needy:
    """Checks that a component exists."""

    parameters: Any

    def check_scenario(self, view: ScenarioView) -> None:
        """Refuse what is missing, in the way that the parameters say."""
        known = [f"{each.group.name}.{each.name}" for each in view.entries]
        needs, told = self.parameters.needs, self.parameters.told
        if needs in known or told == "warn":
            return
        if told == "raise":
            raise ValueError(f"there is no `{needs}`")
        if told == "fail":
            raise RuntimeError("oh")
        if told == "unknown":
            view.report_unknown("component", needs, "with", "needs", known=known)
        else:
            view.report(f"there is no `{needs}`, but {view.steps} steps", "with", "needs", key=False)

    def find_warnings(self, view: ScenarioView) -> None:
        """Warn of what is missing."""
        if self.parameters.told == "warn":
            view.warn(f"of {len(view.groups)} groups none is lucky", "with", "told")


class NeedyComponent(Needy, Plain):
    """A component."""

    Parameters = Need


class NeedyModel(Needy, Line):
    """A model."""

    Parameters = Need


class NeedyEnvironment(Needy, KinematicEnvironment):
    """An environment."""

    class Parameters(Need, KinematicEnvironment.Parameters):
        """Parameters of both."""


class NeedyTopology(Needy, Complete):
    """A topology."""

    class Parameters(Need, TopologyParameters):
        """Parameters of both."""


class NeedyCells(Needy, GridCells):
    """A knowledge model."""

    class Parameters(Need, GridCells.Parameters):
        """Parameters of both."""
