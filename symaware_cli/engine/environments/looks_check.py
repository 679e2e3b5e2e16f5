"""Warns of robots from files of whose looks something is missing."""

from __future__ import annotations

from pathlib import Path

from symaware_cli.core import ScenarioView, WorldError


def warn_of_looks(view: ScenarioView, home: Path, further: tuple[Path, ...]) -> None:
    """Warn of robots of which shapes are missing that are only seen, where the scenario names their files.

    Args:
        view: The scenario; takes the warnings.
        home: The scenario's folder.
        further: Further folders with files of robots.
    """
    document = view.document
    bodies = [(("environment", "entities", name), each.shape) for name, each in document.environment.entities.items()]
    bodies += [(("agents", name, "entity"), each.entity.shape) for name, each in document.agents.items()]
    for section, shape in bodies:
        if shape is None or shape.robot is None:
            continue
        # Most scenarios need none of the readers of such files.
        from symaware_cli.assets import AssetFolders, asset

        try:
            unseen = asset.described(shape.robot.file, AssetFolders(home, further)).unseen
        except WorldError:
            continue  # others report it
        if unseen:
            more = f", and {len(unseen) - 1} more such shapes" if len(unseen) > 1 else ""
            said = f"what `{shape.robot.file}` looks like is not complete: {unseen[0]}{more}"
            view.warn(said, "shape", shape.kind, "file", section=section, code="unseen")
