"""Asset files of a scenario: checks and collects the files that shapes and parameters of components refer to."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath

from symaware_cli.core import Entity, Environment, Mesh, Obstacle, Urdf, WorldError
from symaware_cli.environments import asset
from symaware_cli.scenario.diagnosis import Diagnosis
from symaware_cli.scenario.document import ScenarioDocument
from symaware_cli.scenario.section import Use
from symaware_cli.scenario.source import Path


def check_assets(document: ScenarioDocument, environment: Environment, folder: FilePath, diagnosis: Diagnosis) -> None:
    """Report every missing or invalid file, even if the world does not use it.

    Args:
        document: The validated document.
        environment: The environment, not initialised yet.
        folder: The scenario's folder.
        diagnosis: Takes problems.
    """
    for path, name, body in _named(document):
        if body is not None and asset.is_packaged(name) and "vehicles" not in environment.provides:
            # A world that represents such bodies by discs does not need the package that contains the file.
            continue
        try:
            file = asset.find(name, folder)
        except WorldError as error:
            diagnosis.report("missing-file", str(error), path)
            continue
        try:
            if isinstance(body, Urdf):
                asset.check_description(file, name, folder)
        except WorldError as error:
            diagnosis.report("unsuitable", str(error), path)


def assets(document: ScenarioDocument, folder: FilePath) -> dict[str, bytes]:
    """Return the contents of the files and of those that they refer to, by path relative to the folder."""
    files = [file for _, file, _ in _named(document)]
    return {name: content for file in files for name, content in asset.needed(file, folder).items()}


def _named(document: ScenarioDocument) -> Iterator[tuple[Path, str, Mesh | Urdf | None]]:
    """Yield the path of every name of a file, the name, and the shape that it defines, if it is one.

    A parameter of a component or of a knowledge model is a file if it is a mapping with the key ``file``.
    """
    bodies: dict[Path, Entity | Obstacle] = {
        ("environment", "entities", name): entity for name, entity in document.environment.entities.items()
    }
    bodies |= {("agents", name, "entity"): agents.entity for name, agents in document.agents.items()}
    for path, owner in bodies.items():
        shape = owner.shape
        body = (shape.mesh or shape.urdf) if shape else None
        if shape and body:
            yield (*path, "shape", shape.kind, "file"), body.file, body
    uses: dict[Path, Use] = {("knowledge_models", name): model for name, model in document.knowledge_models.items()}
    for name, agents in document.agents.items():
        uses |= {("agents", name, "components", component): use for component, use in agents.components.items()}
    uses |= {("faults", name, "replace"): fault.replace for name, fault in document.faults.items() if fault.replace}
    for path, use in uses.items():
        for key, value in use.with_.items():
            if isinstance(value, dict) and isinstance(value.get("file"), str):
                yield (*path, "with", key, "file"), value["file"], None
