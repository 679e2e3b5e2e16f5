"""Knowledge models that are read from files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NoReturn, Protocol

import numpy as np
from pydantic import Field

from symaware_cli.geometry import AssetPath, Region
from symaware_cli.knowledge.abstraction.dot import DotError, read_dot
from symaware_cli.knowledge.abstraction.grid_cells import labels_of
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.knowledge.abstraction.region_graph import boxes, shared_side
from symaware_cli.knowledge.abstraction.side_file import SideFile
from symaware_cli.knowledge.abstraction.transition_system import GraphError, TransitionSystem
from symaware_cli.world import ParameterError, Parameters


class _Refuse(Protocol):
    """Refuses a file for a problem with a state, or with the transition from it to another one."""

    def __call__(self, message: str, state: str, following: str | None = None) -> NoReturn: ...


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
        file = self._open()
        if self.folder.joinpath(self.parameters.graph.file).suffix.lower() == ".dot":
            system, refuse = self._of_dot(file)
        else:
            system, refuse = self._of_yaml(file)
        if not self.parameters.places:
            self.bounds = np.empty((0, 2, 2))
            self.system = _named(system)
            return
        for name in system.states:
            if name not in regions:
                refuse(f"there is no region `{name}`", name)
        self.bounds = boxes(system.states, regions, "graph")
        for state, after in enumerate(system.successors):
            for following in after:
                if following != state and not shared_side(self.bounds[state], self.bounds[following]):
                    one, other = system.states[state], system.states[following]
                    refuse(f"`{one}` and `{other}` share no side, so there is no way", one, other)
        known = labels_of(self.bounds, regions)
        for label in system.labels:
            if label in known:
                raise ParameterError(f"`{label}` is a region; call the label something else", ("graph",))
        self.system = replace(system, labels={**known, **system.labels})

    def _open(self) -> SideFile:
        name = self.parameters.graph.file
        path = self.folder / name
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise ParameterError(f"{name}: it leads out of the scenario's folder", ("graph", "file"))
        if not path.exists():  # reported with all files that are missing
            raise ParameterError(f"there is no file {name}", ("graph", "file"), is_consequence=True)
        return self.open_file(path)

    def _of_dot(self, file: SideFile) -> tuple[TransitionSystem, _Refuse]:
        try:
            graph = read_dot(file.text)
            system = TransitionSystem.from_graph(graph)
        except DotError as error:
            file.refuse(str(error), error.line, error.column)

        def refuse(message: str, state: str, following: str | None = None) -> NoReturn:
            edges = (token for one, other, token in graph.edges if (one, other) == (state, following))
            token = next(edges, graph.tokens[state])
            file.refuse(message, token.line, token.column)

        return system, refuse

    def _of_yaml(self, file: SideFile) -> tuple[TransitionSystem, _Refuse]:
        data = file.names()
        try:
            system = TransitionSystem.from_data(data)
        except GraphError as error:
            file.refuse_value(str(error), error.place)

        def refuse(message: str, state: str, following: str | None = None) -> NoReturn:
            if following is None:
                file.refuse_value(message, ("transitions", state), key=True)
            file.refuse_value(message, ("transitions", state, data["transitions"][state].index(following)))

        return system, refuse


def _named(system: TransitionSystem) -> TransitionSystem:
    """Return a system without places, in which the name of each state is a label of it."""
    if len(system.initial) != 1:
        raise ParameterError("what has no place begins in one state; give one as initial", ("graph",))
    names = {name: frozenset([state]) for state, name in enumerate(system.states)}
    for label in system.labels:
        if label in names:
            raise ParameterError(f"`{label}` is a state; call the label something else", ("graph",))
    return replace(system, labels={**names, **system.labels})
