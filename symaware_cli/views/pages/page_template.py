"""Renders HTML from the templates of this package, in which everything that is inserted is escaped."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


def rendered(template: str, **content: Any) -> Markup:
    """Render a template.

    Args:
        template: Its name in the folder of templates.
        content: What it inserts, by name. Texts are escaped; results of this function are inserted as they are.
    """
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(content))


@cache
def _environment() -> Environment:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("symaware_cli.views.pages"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "ensure_ascii": False, "allow_nan": False}
    environment.globals["script"] = _script
    return environment


def _script(name: str) -> Markup:
    """Return a script of this package as the content of a script element."""
    from markupsafe import Markup

    return Markup(files("symaware_cli.views").joinpath(name).read_text(encoding="utf-8"))
