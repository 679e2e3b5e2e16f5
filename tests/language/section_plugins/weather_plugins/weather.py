"""A section of scenarios, and a component that reads it."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from symaware_cli import AgentGroup, Component, ScenarioSection, ScenarioView, SectionContext

Speed = Annotated[float, Field(ge=0, description="Speed [m/s].")]


class Weather(ScenarioSection):
    """Winds by the names of regions."""

    form: ClassVar[Any] = dict[str, Speed]
    description: ClassVar[str] = "Speeds of the wind, by the names of regions [m/s]."

    def build(self, written: Any, context: SectionContext) -> Mapping[str, float]:
        """Check that the regions exist."""
        for name in written if context.document is not None else ():
            if name not in context.regions:
                context.report(f"there is no region `{name}`", name, key=True, code="unknown-target")
        return dict(written)

    def connect(self, built: Mapping[str, float], simulation: Any) -> None:
        """Say so when the run begins."""
        simulation.events.subscribe("started", lambda event: STARTED.append(dict(built)), "*")


#: What the sections of the runs had.
STARTED: list[Mapping[str, float]] = []


class Broken(ScenarioSection):
    """A section that fails."""

    description: ClassVar[str] = "Any text."

    def build(self, written: Any, context: SectionContext) -> Any:
        """Fail."""
        raise RuntimeError("no weather today")


class Sail(Component):
    """A component that needs wind."""

    def check(self, group: AgentGroup) -> None:
        """Check that there is some."""
        if not any(self._winds(group)):
            raise ValueError("there is no wind")

    def check_scenario(self, view: ScenarioView) -> None:
        """Warn of storms."""
        assert view.entry is not None
        if max(self._winds(view.entry.group)) > 20.0:
            view.report("it breaks in a storm")

    def _winds(self, group: AgentGroup) -> Iterator[float]:
        yield from group.sections.get("weather", {}).values()

    def _compute(self) -> None:
        return None

    def _update(self, value: None) -> None:
        pass
