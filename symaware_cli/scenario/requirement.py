"""Whether the world has what components require of it, and the bodies that they name."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from symaware_cli.core import AgentGroup, Environment
from symaware_cli.runtime.simulation import Slot
from symaware_cli.scenario.document import Scenario
from symaware_cli.scenario.problem import nearest, quoted

#: So many names are listed where one is unknown.
_LISTED = 6


def check_requirements(
    document: Scenario,
    environment: Environment,
    groups: Sequence[AgentGroup],
    slots: Sequence[Slot],
    report: Callable[..., None],
) -> None:
    """Report each component that cannot work in its world.

    Args:
        document: What the scenario says.
        environment: The world, in which nobody is in place yet.
        groups: Those that could be made.
        slots: Their components.
        report: Takes the code and the message of a problem, the path, and hints.
    """
    agents = [id for group in groups for id in group.ids]
    names = {"agent": agents, "agent or entity": [*agents, *document.environment.entities]}
    complete = len(groups) == len(document.agents)
    for slot in slots:
        component, path = slot.components[0], ("agents", slot.group.name, "components", slot.name)
        for name, where in component.requires.items():
            if name not in environment.provides:
                world = quoted(document.environment.use)
                message = f"{quoted(slot.use)} needs {name}, and the world {world} has none"
                report("unsuitable", message, path, key=True, expected=where)
        for parameter, kind in component.bodies.items() if complete else ():
            if kind not in names or not hasattr(component.parameters, parameter):
                report("broken-plugin", f"{quoted(slot.use)} has no parameter `{parameter}` that names an {kind}", path)
                continue
            body, known = getattr(component.parameters, parameter), names[kind]
            if isinstance(body, str) and body not in known:
                listed = ", ".join(known[:_LISTED]) + (", ..." if len(known) > _LISTED else "")
                report(
                    "unknown-target",
                    f"there is no {kind} {quoted(body)}",
                    (*path, "with", parameter),
                    expected=f"one of {listed}",
                    suggestion=nearest(body, known),
                )
