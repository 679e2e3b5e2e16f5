"""Asset files of a scenario: checks and collects the files that shapes and parameters of components refer to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from symaware_cli.assets import asset
from symaware_cli.core import Environment, Mesh, WorldError
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.problem import quoted
from symaware_cli.language.source import Path

if TYPE_CHECKING:
    from symaware_cli.core import Entity, Mjcf, Obstacle, Urdf

Parameters = Mapping[Path, Mapping[str, Any]]


def asset_folders(document: ScenarioDocument, folder: FilePath) -> asset.AssetFolders:
    """Return the folders of a scenario that exist.

    Args:
        document: The validated document.
        folder: The scenario's folder.
    """
    return asset.AssetFolders(folder, tuple(folder / name for name in document.assets if _is_folder(folder, name)))


def _is_folder(folder: FilePath, name: str) -> bool:
    return "\0" not in name and (folder / name).is_dir()


def check_assets(
    document: ScenarioDocument,
    further: Parameters,
    environment: Environment,
    folders: asset.AssetFolders,
    diagnosis: Diagnosis,
) -> None:
    """Report every missing or invalid file, even if the world does not use it.

    A folder that does not exist is a problem only if there are others, and a warning otherwise: a copy of a scenario,
    such as that of a sweep, has the files beside it, and need not be where these folders are.

    Args:
        document: The validated document.
        further: The parameters of the plugins in sections that plugins add, by path.
        environment: The environment, not initialised yet.
        folders: The scenario's folders.
        diagnosis: Takes problems and warnings.
    """
    before = len(diagnosis.problems)
    for path, name, body in _named(document, further):
        if body is not None and asset.is_packaged(name) and "vehicles" not in environment.provides:
            # A world that represents such bodies by discs does not need the package that contains the file.
            continue
        # Only shapes may be outside of the scenario's folder.
        places = asset.AssetFolders(folders.home) if body is None else folders
        try:
            asset.find(name, places)
        except WorldError as error:
            diagnosis.report("missing-file", str(error), path)
            continue
        try:
            if body is not None:
                asset.check(name, places, missing="refuse" if isinstance(body, Mesh) else body.missing)
        except WorldError as error:
            diagnosis.report("unsuitable", str(error), path)
    tell = diagnosis.warn if len(diagnosis.problems) == before else diagnosis.report
    for number, name in enumerate(document.assets):
        if not _is_folder(folders.home, name):
            tell("missing-file", f"there is no folder {quoted(name)}", ("assets", number))


def assets(document: ScenarioDocument, further: Parameters, folders: asset.AssetFolders) -> dict[str, bytes]:
    """Return the contents of the files and of the files they refer to, by path relative to the folder."""
    files = [file for _, file, _ in _named(document, further)]
    return {name: content for file in files for name, content in asset.needed(file, folders).items()}


def _named(document: ScenarioDocument, further: Parameters) -> Iterator[tuple[Path, str, Mesh | Urdf | Mjcf | None]]:
    """Yield the path of every name of a file, the name, and the shape that it defines, if it is one.

    A parameter of a plugin is a file if it is a mapping with the key ``file``.
    """
    bodies: dict[Path, Entity | Obstacle] = {
        ("environment", "entities", name): entity for name, entity in document.environment.entities.items()
    }
    bodies |= {("agents", name, "entity"): agents.entity for name, agents in document.agents.items()}
    for path, owner in bodies.items():
        shape = owner.shape
        body = (shape.mesh or shape.robot) if shape else None
        if shape and body:
            yield (*path, "shape", shape.kind, "file"), body.file, body
    given: dict[Path, Mapping[str, Any]] = {(*path, "with"): parameters for path, parameters in further.items()}
    for name, agents in document.agents.items():
        given["agents", name, "model", "with"] = agents.model.with_
        for component, use in agents.components.items():
            path = ("agents", name, "components", component)
            given[*path, "with"] = use.with_
            given |= {(*path, "own", number): own for number, own in use.own.items()}
    for name, fault in document.faults.items():
        if fault.plugin is not None and fault.plugin.component_key:
            given["faults", name, fault.kind, "with"] = fault.content.with_
    for path, parameters in given.items():
        for key, value in parameters.items():
            if isinstance(value, dict) and isinstance(value.get("file"), str):
                yield (*path, key, "file"), value["file"], None
