"""A camera: images of the world from the poses of agents."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, Frame, Image
from symaware_cli.engine.components.sensor import Sensor, SensorParameters
from symaware_cli.geometry import Array

Pixels = Annotated[int, Field(ge=1, le=4096)]


class Camera(Sensor):
    """Takes images of each agent's surroundings: the colour, depth and body of each pixel.

    It points forwards along the heading, at a point, or at an agent or entity. It stays level however the agent tilts:
    upwards in the image is upwards in the world. Images are made on the CPU, so no screen is needed, by worlds that
    have them. Bodies from URDF files look as described there if the world has `visuals: true`.

    Errors are normal, without bias, and independent of each other.

    It stores its images among the readings of the group's awareness, under its own name, and updates nothing else.
    """

    bodies: ClassVar = {"look_at": "agent or entity"}
    requires: ClassVar = {"images": "a world that has images"}

    class Parameters(SensorParameters):
        """Parameters of the camera."""

        width: Pixels = Field(160, description="Width of the images [pixels].")
        height: Pixels = Field(120, description="Height of the images [pixels].")
        field_of_view: float = Field(
            math.pi / 3, ge=1e-3, le=3.1, description="The angle from the lower to the upper edge [rad]."
        )
        look_at: str | tuple[float, float, float] | None = Field(
            None,
            description="An agent or entity, or a point [x, y, z] [m], in the middle of the images; forwards if null.",
        )
        pitch: float = Field(
            0.0,
            gt=-math.pi / 2,
            lt=math.pi / 2,
            description="How far above the horizon it looks, forwards [rad]; negative below.",
        )
        position: tuple[float, float, float] = Field(
            (0.0, 0.0, 0.0),
            description="Where it sits on the body: forwards, leftwards, upwards of its position [m].",
        )
        depth_noise: float = Field(0.0, ge=0, description="Standard deviation of depths [m].")
        colour_noise: float = Field(0.0, ge=0, description="Standard deviation of colours, of which 255 is the most.")

    def initialise_component(self, group: AgentGroup) -> None:
        """Check that the world supports images.

        Raises:
            ValueError: The world has no images, or `look_at` names no agent and no entity.
        """
        super().initialise_component(group)
        environment, look_at = self.environment, self.parameters.look_at
        if "images" not in environment.provides:
            raise ValueError("this world has no images")
        if isinstance(look_at, str) and look_at not in environment.roster and look_at not in environment.obstacles:
            raise ValueError(f"`look_at` names `{look_at}`, which is no agent and no entity")

    def measure(self, present: None) -> Frame:
        """Take an image of each agent's surroundings."""
        parameters, environment, count = self.parameters, self.environment, len(self._group)
        positions, headings = environment.body_positions(self._group.ids), self._headings()
        forwards, leftwards, upwards = parameters.position
        cosine, sine = np.cos(headings), np.sin(headings)
        positions = positions + np.stack(
            [
                forwards * cosine - leftwards * sine,
                forwards * sine + leftwards * cosine,
                np.full(count, upwards),
            ],
            axis=1,
        )
        level = math.cos(parameters.pitch)
        ahead = np.stack([level * cosine, level * sine, np.full(count, math.sin(parameters.pitch))], axis=1)
        targets = positions + ahead
        middle = self._target()
        if middle is not None:
            # An agent that looks at itself looks ahead.
            elsewhere = np.linalg.norm(middle - positions, axis=1) > 1e-6
            targets[elsewhere] = middle
        size = parameters.width, parameters.height
        lost = (
            self.random.uniform(1, "dropout")[:, 0] < parameters.dropout
            if parameters.dropout
            else np.zeros(count, bool)
        )
        images = [
            None
            if lost[row]
            else environment.camera_image(
                positions[row].tolist(), targets[row].tolist(), size, parameters.field_of_view
            )
            for row in range(count)
        ]
        for array in (positions, targets):
            array.flags.writeable = False
        return Frame(self.now, self._with_noise(images), parameters.field_of_view, positions, targets)

    def _target(self) -> Array | None:
        """Return the point that it looks at [m]; None for forwards."""
        look_at, environment = self.parameters.look_at, self.environment
        if look_at is None:
            return None
        if not isinstance(look_at, str):
            return np.array(look_at)
        middle: Array = environment.body_positions([look_at])[0]
        return middle

    def _with_noise(self, images: Sequence[Image | None]) -> Sequence[Image | None]:
        """Add the measurement errors to images."""
        parameters = self.parameters
        if not parameters.depth_noise and not parameters.colour_noise:
            return images
        pixels = parameters.width * parameters.height
        errors = self.random.standard_normal(pixels, "depth") if parameters.depth_noise else None
        shifts = self.random.standard_normal(3 * pixels, "colour") if parameters.colour_noise else None
        blurred: list[Image | None] = []
        for row, image in enumerate(images):
            if image is None:
                blurred.append(None)
                continue
            colour, depth = image.colour, image.depth
            if errors is not None:
                depth = np.maximum(depth + parameters.depth_noise * errors[row].reshape(depth.shape), 0.0)
            if shifts is not None:
                shift = parameters.colour_noise * shifts[row].reshape(colour.shape)
                colour = np.clip(np.rint(colour + shift), 0, 255).astype(np.uint8)
            blurred.append(Image(colour, depth, image.segments))
        return blurred
