"""``symaware list``."""

from __future__ import annotations

from typing import Annotated

import typer

from symaware_cli.cli.terminal import WRONG_INPUT, Json, OwnPlugins, bold, fail, print_json, say
from symaware_cli.help_place import in_help


@in_help("author", 20)
def list_plugins(
    kind: Annotated[str | None, typer.Argument(help="The kind, such as `components`; by default all.")] = None,
    plugins: OwnPlugins = None,
    as_json: Json = False,
) -> None:
    """List the installed plugins, with their packages."""
    from symaware_cli.cli.plugin_catalogue import every_plugin

    catalogue = every_plugin(plugins or ())
    kinds = {each.plural: each for each in catalogue.kinds.values()}
    if kind is not None and kind not in kinds:
        fail(f"there are no plugins of the kind `{kind}`; there are {', '.join(kinds)}", WRONG_INPUT, as_json)
    wanted = [each for plural, each in kinds.items() if kind in (None, plural)]
    listings = {each.plural: catalogue.listings(each.name) for each in wanted}
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
    for plural, same in listings.items():
        if not same:
            continue
        say(bold(plural))
        for listing in same:
            note = " (not used: the name is built in)" if catalogue.is_shadowed(listing) else ""
            say(f"  {listing.name:<{width}}  {listing.package} {listing.version}{note}")
    say("\nsymaware show NAME lists the parameters of one.")
