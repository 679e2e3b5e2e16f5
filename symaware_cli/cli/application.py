"""The command ``symaware`` and its verbs."""

from __future__ import annotations

from typing import Annotated

import typer

from symaware_cli.cli import (
    branch,
    certify,
    check,
    diff,
    estimate,
    export,
    falsify,
    inspect,
    list,  # noqa: A004 (a verb)
    merge,
    new,
    plot,
    recover,
    replay,
    reporting,
    run,
    schema,
    show,
    sweep,
    validate,
    verify,
)
from symaware_cli.cli.terminal import is_plain

application = typer.Typer(
    name="symaware",
    help="Run multi-agent scenarios with situational awareness: deterministic, recorded, checkable.",
    epilog="Exit status: 0 success; 1 the run failed, or `verify` or `diff` found a difference; 2 the input is "
    "invalid; 3 success, but data was lost, a specification is violated, or a claim is not established; 130 "
    "interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Help and usage errors, too: Rich would leave out the colours and keep the rest.
    rich_markup_mode=None if is_plain() else "rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from symaware_cli.version import __version__

        typer.echo(f"symaware {__version__}")
        raise typer.Exit


@application.callback()
def _symaware(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Run multi-agent scenarios with situational awareness: deterministic, recorded, checkable."""


for _verb in (
    run.run,
    sweep.sweep,
    validate.validate,
    new.new,
    replay.replay,
    plot.plot,
    export.export,
    inspect.inspect,
    check.check,
    verify.verify,
    certify.certify,
    falsify.falsify,
    estimate.estimate,
    diff.diff,
    reporting.report,
    branch.branch,
    recover.recover,
    merge.merge,
    list.list_plugins,
    show.show,
    schema.schema,
):
    application.command(_verb.__name__.partition("_")[0], cls=sweep.SweepCommand if _verb is sweep.sweep else None)(
        _verb
    )
