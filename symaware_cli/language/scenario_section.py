"""Sections of scenarios that plugins add: the form of the contents under a new key, and how to build objects from it.

Reasons: docs/decisions/0069-sections-of-plugins.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, ClassVar, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.assets import AssetFolders
from symaware_cli.core import Plugin
from symaware_cli.engine import Simulation
from symaware_cli.language.problem import Problem
from symaware_cli.language.section import Section
from symaware_cli.language.source import Path
from symaware_cli.world import PluginKind, record

if TYPE_CHECKING:
    from symaware_cli.core import Obstacle
    from symaware_cli.geometry import Region
    from symaware_cli.language.specification_section import SpecificationUse


@record
class Additions:
    """The additions of a section to its scenario.

    Attributes:
        entities: Bodies that become part of the world, by name.
        regions: Sets of the workspace, by the names that formulas and conditions refer to.
        bounds: The area that these describe [m], [x, x, y, y]: by default, agents are placed in it. None without one.
        free: The name of the region, among these, that contains all agents that are placed in free space.
        is_drawn: Whether they depend on the seed, so that they differ between runs.
        specifications: Formulas that are monitored like those under `specifications`, by name.
    """

    entities: Mapping[str, Obstacle] = field(default_factory=dict)
    regions: Mapping[str, Region] = field(default_factory=dict)
    bounds: tuple[float, float, float, float] | None = None
    free: str | None = None
    is_drawn: bool = False
    specifications: Mapping[str, SpecificationUse] = field(default_factory=dict)


class InitialAgents(ABC):
    """The agents of a group as they are at the beginning, before the group is built.

    Attributes:
        ids: Their ids.
        radius: The radius of the bounding circle around the position of each [m].
    """

    ids: Sequence[str]
    radius: float

    @property
    @abstractmethod
    def positions(self) -> NDArray[np.float64]:
        """Their positions [m]; shape (n, d). NaN for those that are placed in the space that sections leave free."""

    @abstractmethod
    def known(self, name: str) -> Sequence[Any]:
        """Return the knowledge of each agent under a name; None for agents without it.

        Coordinates that are determined when sections have been built are NaN.
        """


class SectionContext(ABC):
    """The surroundings of a section while it is built; takes the problems of the section.

    Attributes:
        document: The validated scenario; None if it has problems: then the section is built only to check it. It
            contains the additions of sections in `build`, but not yet in `additions`.
        folder: The folder of the scenario; it contains the files that the scenario refers to.
        folders: This folder, and those that the scenario names under `assets`.
        regions: The regions of the scenario, by name; with those that sections add in `build`.
    """

    document: Any
    folder: FilePath
    folders: AssetFolders
    regions: Mapping[str, Region]

    @abstractmethod
    def agents(self) -> Sequence[InitialAgents]:
        """Return the agents of each group at the beginning, in the order of the roster.

        Groups whose initial states or knowledge are invalid, which is reported elsewhere, are left out.
        """

    @abstractmethod
    def make(self, entry: Any, *place: str | int) -> Plugin | None:
        """Instantiate the plugin that an entry names with `use`; None after a problem, which is reported.

        Args:
            entry: The entry, as written.
            place: Its place below the section.
        """

    @abstractmethod
    def report(
        self,
        message: str,
        *place: str | int,
        key: bool = False,
        code: str = "unsuitable",
        expected: str | None = None,
        suggestion: str | None = None,
    ) -> None:
        """Refuse the scenario.

        Args:
            message: A sentence for the author of the scenario, without a full stop.
            place: The path of the problem, below the section.
            key: Whether the message is about the key at that place, not its value.
            code: A stable identifier of the kind of problem.
            expected: A description of valid values.
            suggestion: The nearest valid name.
        """

    @abstractmethod
    def add(self, problems: Iterable[Problem]) -> None:
        """Add problems of another file, with positions in that file."""


class ScenarioSection:
    """A section of scenarios, registered in the group `symaware.sections` under its key.

    Attributes:
        form: The type of the contents: the annotation of a field of a pydantic model. A section that is left out is
            null, or empty if it is a mapping.
        description: Its purpose, in one or two sentences.
        uses: The kinds of plugins that its entries name with `use`, with the models of these entries.
    """

    form: ClassVar[Any] = dict[str, Any] | None
    description: ClassVar[str] = ""
    uses: ClassVar[Mapping[PluginKind, type[Section]]] = {}

    @classmethod
    def field(cls) -> Any:
        """The field of the document."""
        if get_origin(cls.form) is dict:
            return Field(default_factory=dict, description=cls.description)
        return Field(None, description=cls.description)

    @classmethod
    def plugins_in(cls, written: Any) -> Iterator[tuple[PluginKind, Path, Any]]:
        """Yield the kind, the place below the section, and the entry of each plugin that is named.

        Args:
            written: The section as plain data, which may be invalid.
        """
        return iter(())

    def additions(self, written: Any, context: SectionContext) -> Additions:
        """Return the additions of the section to the scenario: bodies of the world, regions, and specifications.

        Called before `build`, on the same object, and only for a valid scenario. Problems are reported to the context.

        Args:
            written: The section as plain data.
            context: The surroundings.
        """
        return Additions()

    def build(self, written: Any, context: SectionContext) -> Any:
        """Build an object from the section, before the groups are built.

        Components find the result in `group.sections`; it is also in `Built.sections`.

        Args:
            written: The section as plain data; it may be invalid if `context.document` is None.
            context: The surroundings.
        """
        return written

    def plugins(self, built: Any) -> Mapping[Path, Plugin]:
        """Return the plugins that check the whole scenario, by their places below the section."""
        return {}

    def files(self, built: Any) -> Mapping[str, bytes]:
        """Return the files that were read, by their paths below the scenario's folder.

        The log contains them, so that it can be run again without the folder.
        """
        return {}

    def connect(self, built: Any, simulation: Simulation) -> None:
        """Connect the result of `build` with the simulation; called if the scenario is valid."""


class SectionKind(PluginKind):
    """Sections of scenarios."""

    def is_name(self, name: str) -> bool:
        """Whether a name may be a key of scenarios: an identifier."""
        return name.isidentifier() and not name.startswith("_")


SECTION = SectionKind("section", "symaware.sections", (ScenarioSection,))
