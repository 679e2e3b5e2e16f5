"""Plugins in files beside a scenario, which are executed only if the person who runs it trusts them.

The modules of these files are imported as `symaware_cli.plugin_files.of_DIGEST.NAME`, so that two scenarios may have
files of the same name, and files that were edited are other modules.

Reasons: docs/decisions/0075-plugin-files.md
"""

from symaware_cli.interface import interface_of
from symaware_cli.plugin_files import loading as loading  # finds their modules, also in processes that a run starts

__getattr__, __dir__, __all__ = interface_of(__name__, __file__)
