"""``symaware certify``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Never

import typer

from symaware_cli.cli.result_files import Results, note
from symaware_cli.cli.terminal import VIOLATED, WRONG_INPUT, Json, fail, output_kept, print_json, say, trouble_shown
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.evidence import Certificate, ResultCase

#: How many combinations are shown.
_MOST = 20


@in_help("check", 40)
def certify(
    folders: Annotated[
        list[Path],
        typer.Argument(
            help="The folder of a finished sweep. Of several, the product of their claims is decided.",
            metavar="DIR...",
        ),
    ],
    claim: Annotated[
        str | None,
        typer.Option(
            help="A claim that is not in the plan: it is evaluated post hoc, and neither certified nor signed.",
            metavar="CLAIM",
        ),
    ] = None,
    key: Annotated[
        Path | None,
        typer.Option(
            help="Sign with this private key: `openssl genpkey -algorithm ed25519 -out key.pem`.", metavar="FILE"
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The certificate, by default certificate.json in DIR.", metavar="FILE"),
    ] = None,
    results: Results = None,
    as_json: Json = False,
) -> None:
    """Decide the claim of a sweep, or the product of those of several. Exit status 3 if it is not established."""
    if len(folders) > 1:
        for name, given in (("--claim", claim), ("--key", key), ("--output", output), ("--results", results)):
            if given:
                fail(f"{name} is for a single sweep: a product rests on the certificate of each", WRONG_INPUT, as_json)
        _decide_product(folders, as_json)
    folder = folders[0]
    with trouble_shown(as_json), output_kept(as_json):
        from symaware_cli.evidence import certify

        try:
            made = certify(folder, claim=claim, key=key, output=output)
        except ValueError as error:
            if claim is None:
                raise
            fail(f"--claim {claim}: {error}", WRONG_INPUT, as_json)
    note(lambda: _cases(folder, made))
    if as_json:
        print_json(made.to_json())
    else:
        say("\n".join(_lines(folder, made)))
    raise typer.Exit(0 if made.is_established else VIOLATED)


def _decide_product(folders: Sequence[Path], as_json: bool) -> Never:
    """Print the decision on the product of claims, and end."""
    with trouble_shown(as_json):
        from symaware_cli.evidence import certify_product

        made = certify_product(folders)
    if as_json:
        print_json(made.to_json())
    else:
        say(f"{made}: {'certified' if made.is_established else 'not certified'}")
        for each in made.factors:
            claimed = f"{each.term} with confidence {each.confidence:.9g}"
            say(f"  {'factor':<12} {claimed}: {'' if each.is_established else 'not '}established in {each.folder}")
    raise typer.Exit(0 if made.is_established else VIOLATED)


def _cases(folder: Path, made: Certificate) -> Iterable[ResultCase]:
    from symaware_cli.evidence import certificate_cases

    return certificate_cases(folder, made)


def _lines(folder: Path, made: Certificate) -> Iterator[str]:
    from symaware_cli.evidence import decided

    said = made.statement["predicate"]
    cells = said["combinations"]
    established = sum(each["established"] for each in cells)
    outcome = "established" if made.is_established else "not established"
    if made.is_post_hoc:
        yield f"{folder}: POST HOC, not certified: the claim was chosen after the runs; otherwise {outcome}"
    else:
        yield f"{folder}: {'certified' if made.is_established else 'not certified'}"
    yield f"  {'claim':<12} {said['claim']['text']}, stated {said['claim']['stated']}"
    yield f"  {'over':<12} {said['probability_over']}"
    if len(cells) > 1:
        yield f"  {'combinations':<12} {established:,} of {len(cells):,}, error probability {said['alpha']:g} jointly"
    for cell in cells[:_MOST]:
        named = [*filter(None, [cell["variant"]]), *(f"{k}={v}" for k, v in cell["parameters"].items())]
        for term, each in decided(cell):
            against = ", ".join(f"{count:,} {name}" for name, count in each["against"].items() if count)
            text = f"{each['runs']:,}; against it: {against or 'none'}; "
            text += f"evidence {each['evidence']:.4g} of {each['needed']:.4g}"
            name = ", ".join([*named, *([term] if term else [])])
            yield f"  {'runs':<12} {f'{name}: ' if name else ''}{text}"
            if not each["established"]:
                yield f"  {'':<12} with as many against it, {each['runs_needed']:,} runs are needed"
    if len(cells) > _MOST:
        yield f"  {'':<12} {len(cells) - _MOST:,} more; --json lists all of them"
    yield f"  {'rows':<12} {said['rows']['count']:,}, root {said['rows']['root']}"
    if made.path is not None:
        signed = f"signed by {made.public_key}" if made.public_key else "not signed"
        yield f"  {'certificate':<12} {made.path}, {signed}"
        yield f"  {'to print':<12} {made.page}"
