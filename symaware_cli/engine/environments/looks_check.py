"""Warns of robots from files that are loaded without some of their shapes."""

from __future__ import annotations

from pathlib import Path

from symaware_cli.core import ScenarioView, WorldError


def warn_of_looks(view: ScenarioView, home: Path, further: tuple[Path, ...]) -> None:
    """Warn of robots that are loaded without some of their shapes, where the scenario names their files.

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
            robot, folders = shape.robot, AssetFolders(home, further)
            left_out = asset.described(robot.file, folders, missing=robot.missing).left_out
        except WorldError:
            continue  # others report it
        if left_out:
            more = f", and {len(left_out) - 1} more" if len(left_out) > 1 else ""
            said = f"shapes of `{shape.robot.file}` are left out: {left_out[0]}{more}"
            view.warn(said, "shape", shape.kind, "file", section=section, code="shapes-left-out")
