"""Knowledge models that are read from files."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import yaml
from pydantic import Field

from symaware_cli.abstraction.grid_cells import labels_of
from symaware_cli.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.abstraction.region_graph import boxes, shared_side
from symaware_cli.abstraction.transition_system import TransitionSystem
from symaware_cli.geometry.region import Region
from symaware_cli.geometry.shape import AssetPath
from symaware_cli.world.plugin import ParameterError, Parameters

#: The greatest length of a file [bytes].
_MOST_BYTES = 1_000_000


class _Names(yaml.SafeLoader):
    """Reads names as they are written: a state may be called `on` or `1.0`."""


_Names.yaml_implicit_resolvers = {
    first: [each for each in resolvers if each[0] == "tag:yaml.org,2002:null"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


class GraphName(Parameters):
    """The file of a transition system."""

    file: AssetPath = Field(description="A .yaml or .dot file below the scenario's folder.")


class GraphFile(KnowledgeModel):
    """A transition system from a file, whose states are regions of the scenario.

    Only moves that are in the file are made: passages may be one-way or closed. A state that may be stayed in has a
    transition to itself. A cell has the labels of the file and those of the regions that contain it.

    With ``places: false`` the states are those of something without a place, such as a gripper. It begins in the one
    initial state, and the name of each state is a label of it.
    """

    class Parameters(Parameters):
        """The file, and what its states are."""

        graph: GraphName = Field(description="The transition system, as {file: PATH}.")
        places: bool = Field(True, description="Whether states are regions; otherwise they have no places.")

    def prepare(self, regions: Mapping[str, Region]) -> None:
        """Read the file."""
        try:
            system = self._read()
        except FileNotFoundError as error:  # reported with all files that are missing
            raise ParameterError(str(error), ("graph", "file"), is_consequence=True) from None
        except (OSError, ValueError, yaml.YAMLError) as error:
            raise ParameterError(f"{self.parameters.graph.file}: {error}", ("graph", "file")) from None
        if not self.parameters.places:
            self.bounds = np.empty((0, 2, 2))
            self.system = _named(system)
            return
        self.bounds = boxes(system.states, regions, "graph")
        for state, after in enumerate(system.successors):
            for following in after:
                if following != state and not shared_side(self.bounds[state], self.bounds[following]):
                    one, other = system.states[state], system.states[following]
                    raise ParameterError(f"`{one}` and `{other}` share no side, so there is no way", ("graph",))
        known = labels_of(self.bounds, regions)
        for label in system.labels:
            if label in known:
                raise ParameterError(f"`{label}` is a region; call the label something else", ("graph",))
        self.system = TransitionSystem(system.states, system.initial, system.successors, {**known, **system.labels})

    def _read(self) -> TransitionSystem:
        name = self.parameters.graph.file
        path = self.folder / name
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise ValueError("it leads out of the scenario's folder")
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise ValueError(f"it is longer than {_MOST_BYTES:,} bytes")
        text = content.decode()
        if path.suffix == ".dot":
            return TransitionSystem.from_dot(text)
        if any(isinstance(each, yaml.AliasToken) for each in yaml.scan(text)):
            raise ValueError("a transition system is written without aliases")
        return TransitionSystem.from_data(yaml.load(text, Loader=_Names))


def _named(system: TransitionSystem) -> TransitionSystem:
    """Return a system without places, in which the name of each state is a label of it."""
    if len(system.initial) != 1:
        raise ParameterError("what has no place begins in one state; give one as initial", ("graph",))
    names = {name: frozenset([state]) for state, name in enumerate(system.states)}
    for label in system.labels:
        if label in names:
            raise ParameterError(f"`{label}` is a state; call the label something else", ("graph",))
    return TransitionSystem(system.states, system.initial, system.successors, {**names, **system.labels})
