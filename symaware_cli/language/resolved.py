"""Writes the resolved document of a scenario as YAML that reads back as the same document."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.yaml_source import plain_scalar


class _Dumper(yaml.SafeDumper):
    """Quotes text where YAML 1.2 requires it: PyYAML omits quotes by the rules of YAML 1.1."""


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    style = None if isinstance(plain_scalar(text), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def resolved(data: Mapping[str, Any], document: ScenarioDocument) -> bytes:
    """Write the resolved document in the order of the file, with the seed in force."""
    first = {"symaware": document.symaware, "name": document.name, "seed": document.seed}
    # The log has the files that `assets` led to, so that it can be run where these folders do not exist.
    content = {**first, **{key: value for key, value in data.items() if key not in (*first, "assets")}}
    return dumped(_escaped(content))


def dumped(content: Mapping[str, Any]) -> bytes:
    """Write plain data as YAML that reads back the same."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100).encode()


def _escaped(value: Any) -> Any:
    """Return a value in which `${` is escaped in all texts."""
    if isinstance(value, Mapping):
        return {key: _escaped(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_escaped(each) for each in value]
    return value.replace("${", "$${") if isinstance(value, str) else value
