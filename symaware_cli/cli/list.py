"""``symaware list``."""

from __future__ import annotations

import enum
from typing import Annotated

import typer

from symaware_cli.cli.terminal import Json, bold, print_json


class Kind(enum.StrEnum):
    """The kinds of plugins that can be listed."""

    abstractions = "abstractions"
    components = "components"
    environments = "environments"
    metrics = "metrics"
    models = "models"
    topologies = "topologies"
    transports = "transports"


def list_plugins(
    kind: Annotated[Kind | None, typer.Argument(help="What to list; by default everything.")] = None,
    as_json: Json = False,
) -> None:
    """List the plugins that a scenario or a sweep can use, with their packages."""
    from symaware_cli.scenario.catalogue import PLURALS, Catalogue

    catalogue = Catalogue()
    wanted = [each for each in PLURALS if kind is None or kind == PLURALS[each]]
    listings = {each: catalogue.listings(each) for each in wanted}
    if as_json:
        print_json(
            [
                {
                    "kind": each.kind,
                    "name": each.name,
                    "package": each.package,
                    "version": each.version,
                    "class": each.target,
                }
                for same in listings.values()
                for each in same
            ]
        )
        return
    width = max((len(listing.name) for same in listings.values() for listing in same), default=0)
    for each, same in listings.items():
        if not same:
            continue
        typer.echo(bold(PLURALS[each]))
        for listing in same:
            typer.echo(f"  {listing.name:<{width}}  {listing.package} {listing.version}")
    typer.echo("\nsymaware show NAME lists the parameters of one.")
