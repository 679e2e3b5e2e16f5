"""The scenarios that ``symaware new`` writes, from the folder ``templates``."""

from __future__ import annotations

import re
from pathlib import Path
from string import Template

_TEMPLATES = Path(__file__).with_name("templates")

#: Where the comments begin.
_COMMENTS = 33


class TemplateError(Exception):
    """A new scenario cannot have this name, or this theme in this format."""


def template(name: str, *, toml: bool = False, like: str | None = None) -> str:
    """Return a commented scenario with a name.

    Args:
        name: The name.
        toml: Whether it is in TOML instead of YAML.
        like: Its theme, such as ``crossing``; a plain scenario if None.

    Raises:
        TemplateError: The name is invalid, or TOML is asked for with a theme.
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]{0,63}", name):
        raise TemplateError(f"`{name}` is not a name: expected a letter or _, then letters, digits, _ or -")
    if toml and like is not None:
        raise TemplateError("--like scenarios are in YAML only: leave out --toml")
    name_line = f'name = "{name}" ' if toml else f"name: {name} "
    file = _TEMPLATES / f"{like or 'plain'}.{'toml' if toml else 'yaml'}.txt"
    return Template(file.read_text(encoding="utf-8")).substitute(name=name, name_line=name_line.ljust(_COMMENTS))
