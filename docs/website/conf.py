"""What Sphinx is told about the site; `build.py` stages the pages and calls it."""

import ast
import sys
from pathlib import Path

import symaware_cli
from symaware_cli import __version__

project = "SymAware"
author = "The SymAware maintainers"
project_copyright = "The SymAware maintainers, Apache-2.0"
# Without the commit, which does not fit above the navigation.
version = release = __version__.partition("+")[0]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = f"SymAware {version}"
html_show_sphinx = False
html_copy_source = False
html_static_path: list[str] = ["_static"]
html_css_files = ["gallery.css", "sessions.css"]
html_permalinks_icon = "#"

# Headings have the anchors that they have in a repository's viewer, so that the same links work in both.
myst_heading_anchors = 5
# A page's address is no address of a machine: what looks like one in the text stays text.
myst_linkify_fuzzy_links = False

default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_class_signature = "separated"
python_use_unqualified_type_names = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
# Types of other packages, and of modules that are not public, have no page here. Links between pages are all checked.
nitpick_ignore_regex = [(r"py:.*", r".*")]


def _import_types() -> None:
    """Import what modules import for type checkers alone, so that annotations in the reference are links to classes."""
    for name in symaware_cli.__all__:
        getattr(symaware_cli, name)  # imports the module where it is defined
    for module in [module for name, module in sys.modules.items() if name.startswith("symaware_cli.")]:
        if not (module.__file__ or "").endswith(".py"):
            continue
        for node in ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body:
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                exec(compile(ast.Module(node.body, []), str(module.__file__), "exec"), vars(module))


_import_types()
