"""Parameters that consist of the name of agents or components alone."""

from __future__ import annotations

from pydantic import ConfigDict, RootModel

from symaware_cli.core.identifiers import AgentPattern, ComponentPattern


class AgentParameters(RootModel[AgentPattern]):
    """Parameters that consist of the name of agents alone."""

    model_config = ConfigDict(frozen=True, defer_build=True)


class ComponentParameters(RootModel[ComponentPattern]):
    """Parameters that consist of the name of components alone."""

    model_config = ConfigDict(frozen=True, defer_build=True)
