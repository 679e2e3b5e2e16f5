"""A section of scenarios, and a component that reads it."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from symaware_cli import (
    Additions,
    AgentGroup,
    Component,
    Obstacle,
    Region,
    ScenarioSection,
    ScenarioView,
    SectionContext,
)

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


class Harbour(ScenarioSection):
    """Buoys by their names, each with a region around it, and with a file that lists them."""

    form: ClassVar[Any] = dict[str, tuple[float, float]]
    description: ClassVar[str] = "Positions of buoys, by name [m]."

    def additions(self, written: Any, context: SectionContext) -> Additions:
        """Add the buoys; none may be where an agent begins."""
        for group in context.agents():
            for name, place in written.items():
                if (abs(group.positions[:, :2] - place).max(axis=1) < 1.0).any():
                    context.report(f"there is an agent of {group.ids[0]}", name)
        buoy = {"shape": {"circle": {"radius": 0.5}}}
        return Additions(
            {name: Obstacle.model_validate({**buoy, "position": tuple(place)}) for name, place in written.items()},
            {
                f"at_{name}": Region.model_validate({"circle": {"centre": tuple(place), "radius": 1.0}})
                for name, place in written.items()
            },
            is_drawn="drifting" in written,
        )

    def files(self, built: Mapping[str, Any]) -> Mapping[str, bytes]:
        """Return the list."""
        return {"buoys.txt": ", ".join(built).encode()}


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
