"""Knowledge models: finite transition systems over cells of the workspace, as a scenario declares them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup
from symaware_cli.geometry import Region
from symaware_cli.knowledge.abstraction.side_file import SideFile
from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.world import ParameterError, Plugin

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class KnowledgeModel(Plugin):
    """A transition system whose states are boxes in the plane that touch where there is a transition.

    The states of something that has no place, such as a gripper, have no boxes. A product of both is a model of an
    agent: two of its states then may have the same box.

    Attributes:
        system: The transition system; a box is labelled with the regions that contain all of it.
        bounds: The least and the greatest coordinates of each box [m]; shape (n, 2, 2), as [cell, axis, which]; n is
            the number of states, or 0 if these have no places.
        folder: The scenario's folder, below which files are found.
        open_file: Reads a file of that folder.
        others: The models that this one is made from, by name.
    """

    folder: Path = Path()
    open_file: Callable[[Path], SideFile]
    others: Mapping[str, KnowledgeModel] = MappingProxyType({})
    system: TransitionSystem
    bounds: Array

    def parts(self) -> Mapping[tuple[str | int, ...], str]:
        """Return the names of the models that this one is made from, by their places in the parameters.

        They are prepared before it, and in `others` when it is.
        """
        return {}

    @abstractmethod
    def prepare(self, regions: Mapping[str, Region]) -> None:
        """Make `system` and `bounds`; called before a run.

        Args:
            regions: The regions of the scenario, by name.

        Raises:
            ValueError: That is not possible; the message explains the reason to the author of the scenario.
        """

    def cells(self, points: Array) -> Indices:
        """Return the cell that contains each point, -1 for none; on a common boundary, the cell with the higher number.

        Args:
            points: Shape (n, d); the first two coordinates count.
        """
        found = np.full(len(points), -1, np.intp)
        for row, point in enumerate(points[:, :2]):
            inside = ((self.bounds[:, :, 0] <= point) & (point <= self.bounds[:, :, 1])).all(axis=1)
            if inside.any():
                found[row] = np.flatnonzero(inside)[-1]
        return found

    def contains(self, cell: int, point: Array) -> bool:
        """Whether a cell, with its boundary, contains a point; shape (d,)."""
        low, high = self.bounds[cell, :, 0], self.bounds[cell, :, 1]
        return bool(((low <= point[:2]) & (point[:2] <= high)).all())

    def distance(self, cell: int, point: Array) -> float:
        """Return the distance of a point from a cell [m], 0 within it; shape (d,)."""
        apart = point[:2] - np.clip(point[:2], self.bounds[cell, :, 0], self.bounds[cell, :, 1])
        return float(np.sqrt(apart @ apart))

    def centre(self, cell: int) -> Array:
        """Return the centre of a cell [m]; shape (2,)."""
        return np.asarray(self.bounds[cell].mean(axis=1))

    def gate(self, cell: int, following: int) -> Array:
        """Return the centre of the side that two cells share [m]; shape (2,)."""
        low = np.maximum(self.bounds[cell, :, 0], self.bounds[following, :, 0])
        high = np.minimum(self.bounds[cell, :, 1], self.bounds[following, :, 1])
        return np.asarray(0.5 * (low + high))


def model_named(name: str, group: AgentGroup) -> KnowledgeModel:
    """Return the knowledge model that the parameter `model` of a component names.

    Raises:
        ParameterError: There is none.
    """
    models: Mapping[str, KnowledgeModel | None] = group.sections.get("knowledge_models", {})
    found = models.get(name)
    if isinstance(found, KnowledgeModel) and not len(found.bounds):
        said = f"the states of `{name}` have no places; name a product of it and a model that has cells"
        raise ParameterError(said, ("model",))
    if isinstance(found, KnowledgeModel):
        return found
    known = ", ".join(sorted(models)) or "none"
    raise ParameterError(f"there is no knowledge model `{name}`; there are: {known}", ("model",), name in models)
