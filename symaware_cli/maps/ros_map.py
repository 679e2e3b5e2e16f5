"""Maps in the format of ROS: a YAML file that names a picture, and the meaning of its grey levels.

The format is that of nav2_map_server (https://docs.nav2.org/configuration/packages/configuring-map-server.html) and of
map_server before it (http://wiki.ros.org/map_server).
"""

from __future__ import annotations

import os
from pathlib import Path as FilePath
from pathlib import PurePosixPath
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.assets import AssetFolders, asset
from symaware_cli.core import WorldError
from symaware_cli.geometry import Length, Number
from symaware_cli.language import (
    Problem,
    ScenarioError,
    Section,
    Source,
    compose_content,
    parse_yaml,
    quoted,
    read_text,
)
from symaware_cli.language import validate as validated
from symaware_cli.maps.map_error import MapError
from symaware_cli.maps.picture import MOST_BYTES, read_picture
from symaware_cli.maps.raster import FREE, OCCUPIED, UNKNOWN, Raster

SUFFIXES = (".yaml", ".yml")

Share = Annotated[float, Field(ge=0, le=1)]


class RosMap(Section):
    """The YAML file of a map."""

    image: str = Field(min_length=1, max_length=500, description="The picture, relative to this file.")
    resolution: Length = Field(description="The side of a pixel [m].")
    origin: tuple[Number, Number, Number] = Field(
        description="The lower left corner of the picture [m], and the direction of its rows [rad]."
    )
    occupied_thresh: Share = Field(description="Cells with a greater probability are occupied.")
    free_thresh: Share = Field(description="Cells with a smaller probability are free.")
    negate: Literal[0, 1] | bool = Field(0, description="Whether white is occupied, and black free.")
    mode: Literal["trinary", "scale", "raw"] = Field("trinary", description="Interpretation of grey levels.")

    @model_validator(mode="after")
    def _is_ordered(self) -> RosMap:
        if self.free_thresh > self.occupied_thresh:
            raise ValueError("`free_thresh` is above `occupied_thresh`")
        return self


def read_ros_map(name: str, path: FilePath, folders: AssetFolders) -> tuple[Raster, dict[str, bytes]]:
    """Read a map and its picture.

    A pixel with the grey level g, from 0 for black to 1 for white, is occupied with the probability 1 - g, or g if the
    map is negated. In mode `scale`, transparent pixels are unknown; in mode `raw`, the levels from 0 to 100 are
    percentages, and others are unknown.

    Args:
        name: The name of the YAML file in the scenario.
        path: The path of the YAML file.
        folders: The folders of the scenario; the picture has to be in or below one of them.

    Returns:
        The map, and both files by their paths relative to the scenario's folder.

    Raises:
        ScenarioError: The map is invalid; contains the problems with their places in the YAML file.
    """
    source = read_text(path, str(path), "the YAML file of a map", SUFFIXES)
    if not source.problems:
        parse_yaml(source)
    if source.problems or source.root is None:
        raise ScenarioError(source.problems or [Problem("wrong-type", "the file is empty", None)])
    composition = compose_content(source.root, source, {})
    found = validated(RosMap, composition.data, composition, ())
    if isinstance(found, list):
        raise ScenarioError(found)
    image = os.path.normpath(PurePosixPath(name).parent / found.image)
    try:
        if PurePosixPath(found.image).is_absolute() or image.startswith("..") or "\0" in image or "\\" in image:
            raise MapError("it has to be below the scenario's folder, with a path relative to this file")
        place = asset.find(image, folders)
        with open(place, "rb") as file:
            content = file.read(MOST_BYTES + 1)
        raster = _raster(found, content, PurePosixPath(image).suffix.lower())
    except (MapError, WorldError) as error:
        raise ScenarioError([_problem(source, found.image, str(error))]) from error
    except OSError as error:
        raise ScenarioError([_problem(source, found.image, f"it cannot be read: {error.strerror}")]) from error
    return raster, {name: path.read_bytes(), image: content}


def _raster(found: RosMap, content: bytes, suffix: str) -> Raster:
    grey, transparent = read_picture(content, suffix)
    chance = grey if found.negate else 1.0 - grey
    unknown = np.zeros(grey.shape, bool)
    if found.mode == "raw":
        percent = np.round(grey * 255.0)
        chance, unknown = percent / 100.0, percent > 100.0
    elif found.mode == "scale":
        unknown = transparent
    cells = np.full(grey.shape, UNKNOWN, np.int8)
    cells[~unknown & (chance > found.occupied_thresh)] = OCCUPIED
    cells[~unknown & (chance < found.free_thresh)] = FREE
    x, y, yaw = found.origin
    return Raster(np.ascontiguousarray(cells[::-1]), found.resolution, (x, y), yaw)


def _problem(source: Source, image: str, message: str) -> Problem:
    """Return a problem with the picture, located at its name in the YAML file."""
    assert source.root is not None
    span = source.root.nearest_span(("image",))
    said = f"the picture {quoted(image)} cannot be used: {message}"
    return Problem("unsuitable", said, span, "image", source_line=source.line_text(span.line))
