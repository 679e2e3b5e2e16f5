"""Checks that the world has the features and bodies that models and components require."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence

from symaware_cli.core import AgentGroup, Environment
from symaware_cli.engine import ComponentEntry, Sensor
from symaware_cli.language.capable_worlds import expected_world
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.problem import quoted
from symaware_cli.log import FIELDS, KINDS


def check_requirements(
    document: ScenarioDocument,
    environment: Environment,
    groups: Sequence[AgentGroup],
    entries: Sequence[ComponentEntry],
    diagnosis: Diagnosis,
    catalogue: Catalogue,
) -> None:
    """Report each model and component that cannot work in its world.

    Args:
        document: The validated document.
        environment: The environment, not initialised yet.
        groups: The groups that could be built.
        entries: Their component entries.
        diagnosis: Takes problems.
        catalogue: The installed plugins, to name suitable worlds.
    """
    agents = [id for group in groups for id in group.ids]
    names = {
        "agent": agents,
        "agents": [*(group.name for group in groups if group.name not in agents), *agents],
        "agent or entity": [*agents, *document.environment.entities],
    }
    names["agents or entities"] = [*names["agents"], *document.environment.entities]
    complete = len(groups) == len(document.agents)
    for group in groups:
        _check_model(document, environment, group, diagnosis, catalogue)
    for entry in entries:
        component, path, variations = entry.components[0], entry.section, entry.variations
        measures = isinstance(component, Sensor) or entry.name in entry.group.awareness.signals
        taken = {*FIELDS, *KINDS}
        if measures and entry.name in (*taken, *entry.group.awareness.parts):
            message = f"a sensor cannot be called {quoted(entry.name)}, the name of another series in the log"
            diagnosis.report("bad-name", message, path, key=True, expected=f"none of {', '.join(sorted(taken))}")
        for name, where in component.requires.items():
            if name not in environment.provides:
                world = quoted(document.environment.use)
                message = f"{quoted(entry.use)} needs {name}, and the world {world} has none"
                expected = expected_world(name, catalogue, where)
                diagnosis.report("unsuitable", message, path, key=True, expected=expected)
        for parameter, kind in component.bodies.items() if complete else ():
            if kind not in names or not hasattr(component.parameters, parameter):
                diagnosis.report(
                    "broken-plugin", f"{quoted(entry.use)} has no parameter `{parameter}` that names an {kind}", path
                )
                continue
            for each, section in variations:
                named, known = getattr(each.parameters, parameter), names[kind]
                if kind.startswith("agents"):
                    for number, pattern in enumerate(named):
                        if not any(fnmatch.fnmatchcase(name, pattern) for name in known):
                            what = "agent or group" if kind == "agents" else "agent, group or entity"
                            diagnosis.report_unknown(what, pattern, (*section, parameter, number), known)
                elif isinstance(named, str) and named not in known:
                    diagnosis.report_unknown(kind, named, (*section, parameter), known)


def _check_model(
    document: ScenarioDocument,
    environment: Environment,
    group: AgentGroup,
    diagnosis: Diagnosis,
    catalogue: Catalogue,
) -> None:
    """Report parameters without effect: of vehicles in worlds without them, and of entities with a built-in body."""
    agents, model, path = document.agents[group.name], group.model, ("agents", group.name)
    for name in model.needs_vehicle:
        if getattr(model.parameters, name) and "vehicles" not in environment.provides:
            world = quoted(document.environment.use)
            message = (
                f"{quoted(agents.model.use)} has {quoted(name)} only in worlds with vehicles, and {world} has none"
            )
            expected = f"false, or {expected_world('vehicles', catalogue)}"
            diagnosis.report("unsuitable", message, (*path, "model", "with", name), expected=expected)
    for name in sorted(agents.entity.model_fields_set - {"shape"}) if model.body else ():
        message = f"{quoted(agents.model.use)} has a built-in body, whose {quoted(name)} cannot be set"
        expected = "only a `shape`, which other agents keep clear of"
        diagnosis.report("unsuitable", message, (*path, "entity", name), key=True, expected=expected)
