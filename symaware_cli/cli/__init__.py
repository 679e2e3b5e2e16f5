"""The command line: one module for each verb, which parses, calls, prints and exits."""

import sys


def main() -> None:
    """Run the command ``symaware``."""
    if sys.argv[1:] == ["--version"]:
        # Before anything is imported: this is what scripts ask for most often.
        from symaware_cli import __version__

        print(f"symaware {__version__}")
        return
    from symaware_cli.cli.application import application

    application()
