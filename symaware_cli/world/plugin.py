"""Base classes of plugins and of their parameters."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict


class Parameters(BaseModel):
    """The parameters of a plugin, which a scenario sets under ``with:``.

    Subclass it inside the plugin under the same name; each field's description states its unit. Values are
    validated before anything runs, and the fields show in ``symaware show`` and in the editor's schema.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


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
