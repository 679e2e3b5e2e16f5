"""The sections of faults: the beginning and duration of each, and its parameters under the key of its kind."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, ClassVar, Self

from pydantic import Field, RootModel, create_model, model_validator

from symaware_cli.engine import Fault
from symaware_cli.language.section import Section, TriggerSection


class FaultUse(Section):
    """A fault: when it begins, its duration, and one of the kinds of faults."""

    #: The classes of the kinds that are fields of the model; None for one that cannot be imported.
    kinds: ClassVar[Mapping[str, type[Fault] | None]] = {}

    #: The names of all kinds.
    installed: ClassVar[Collection[str]] = ()

    at: float | None = Field(None, ge=0, le=1e9, description="When [s].")
    on: TriggerSection | None = Field(None, description="The event at whose first occurrence the fault begins.")
    for_: float | None = Field(
        None, alias="for", gt=0, le=1e9, description="Duration [s]. By default the rest of the run."
    )

    @property
    def kind(self) -> str:
        """The key of its kind."""
        return self._given[0]

    @property
    def plugin(self) -> type[Fault] | None:
        """The class of its kind; None for one that cannot be imported."""
        return self.kinds[self.kind]

    @property
    def content(self) -> Any:
        """The parameters of its kind, written under that key."""
        return getattr(self, _field(self.kinds, self.kind))

    @property
    def _given(self) -> list[str]:
        return [kind for kind in self.kinds if getattr(self, _field(self.kinds, kind)) is not None]

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if (self.at is None) == (self.on is None):
            raise ValueError("give its beginning: either `at` or `on`")
        given = self._given
        if len(given) != 1:
            raise ValueError(f"give one kind of fault: {', '.join(self.installed)}")
        plugin = self.kinds[given[0]]
        if self.for_ is not None and plugin is not None and not plugin.lasts:
            raise ValueError(f"a {given[0]} has no `for`: it happens at once")
        return self


def use_of(kinds: Mapping[str, type[Fault] | None], installed: Collection[str]) -> type[FaultUse]:
    """Create the model of faults of some kinds.

    Args:
        kinds: The classes of the kinds by name; None for one that cannot be imported, whose content is not checked.
        installed: The names of all kinds.
    """
    fields: dict[str, Any] = {}
    for name, plugin in kinds.items():
        form = Any if plugin is None else plugin.Parameters
        about = "" if plugin is None else description_of(plugin)
        fields[_field(kinds, name)] = (form | None, Field(None, alias=name, description=about))
    model = create_model("FaultUse", __base__=FaultUse, **fields)
    model.kinds, model.installed = kinds, installed
    return model


def _field(kinds: Collection[str], kind: str) -> str:
    """The field of a kind; the kind's own name need not be an identifier, and may clash with another attribute."""
    return f"kind_{[*kinds].index(kind)}"


def description_of(plugin: type[Fault]) -> str:
    """The description of a kind: the first line of its docstring and, if it takes a single value, that of the value."""
    text = (plugin.__doc__ or "").strip().partition("\n")[0]
    root = plugin.Parameters.model_fields.get("root") if issubclass(plugin.Parameters, RootModel) else None
    return f"{text} {root.description}" if root is not None and root.description else text
