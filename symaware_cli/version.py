"""The version of the package: from the tags of the repository, at the time of the installation.

Reasons: docs/decisions/0114-version-from-tags.md
"""

try:
    from symaware_cli.installed_version import __version__ as __version__
except ModuleNotFoundError:  # sources that are not installed
    __version__ = "0+unknown"
