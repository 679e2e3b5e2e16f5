"""Base classes of plugins and of their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict


class Parameters(BaseModel):
    """The parameters of a plugin, which a scenario sets under ``with:``.

    Subclass it inside the plugin under the same name; each field's description states its unit. Values are
    validated before anything runs, and the fields show in ``symaware show`` and in the editor's schema.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class ParameterError(ValueError):
    """A parameter of a plugin cannot be used; raised before a run, it is reported at its place in the scenario.

    If its cause is an error in an expression, the message is the text of that expression.

    Attributes:
        place: The keys and indices of the parameter under ``with``, such as ``("guarantees", 0)``.
        is_consequence: Whether it refers to something that is itself wrong, which is reported there.
        related: Other places that are part of the problem, with a text about each.
    """

    def __init__(
        self,
        message: str,
        place: Sequence[str | int],
        is_consequence: bool = False,
        related: Sequence[tuple[Sequence[str | int], str]] = (),
    ) -> None:
        super().__init__(message)
        self.place = tuple(place)
        self.is_consequence = is_consequence
        self.related = tuple(related)


class Plugin:
    """Base class of components, environments, models and topologies.

    Attributes:
        Parameters: The model of the plugin's own parameters.
        parameters: Their values, an instance of it.
    """

    Parameters: ClassVar[type[BaseModel]] = Parameters

    parameters: Any

    def __init__(self, parameters: BaseModel | None = None) -> None:
        self.parameters = self.Parameters() if parameters is None else parameters

    def check_scenario(self, view: Any) -> None:
        """Check the whole scenario before a run; called once for each section that uses the plugin.

        Args:
            view: A `symaware_cli.ScenarioView`: the other plugins with their timing, the groups, links and
                specifications. Problems are reported to it, which locates them in the file.
        """

    def find_warnings(self, view: Any) -> None:
        """Warn of valid but probably unintended values.

        It is called when a valid scenario is validated, and not before a run, so it may take a second.

        Args:
            view: As for `check_scenario`; takes the warnings.
        """
