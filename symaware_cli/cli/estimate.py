"""``symaware estimate``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli import terminal
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.evidence import RareEventEstimate


@in_help("check", 60)
def estimate(
    scenario: terminal.ScenarioPath,
    specification: Annotated[
        str, typer.Option("--specification", help="The specification that the event is about.", metavar="NAME")
    ],
    levels: Annotated[
        str | None,
        typer.Option(
            help="Levels of robustness on the way to the event, such as `3,2,1`; by default a pilot chooses them. "
            "`none`: all trials are plain runs.",
            metavar="VALUES",
        ),
    ] = None,
    event: Annotated[str, typer.Option(help="The event: the specification is violated, or satisfied.")] = "violated",
    trials: Annotated[int, typer.Option(min=1, max=10_000_000, help="Trials of each stage of each repeat.")] = 100,
    repeats: Annotated[
        int, typer.Option(min=2, max=1_000_000, help="Independent repeats, from which the interval is computed.")
    ] = 20,
    confidence: Annotated[float, typer.Option(help="Confidence of the interval.")] = 0.95,
    overrides: terminal.Overrides = None,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of all random draws.")] = 0,
    jobs: terminal.Jobs = None,
    trust: terminal.Trust = False,
    as_json: terminal.Json = False,
) -> None:
    """Estimate how probable a rare event is, by splitting runs where they come closer to it."""
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import EVENT_KINDS, estimate

        kind = next((each for each in EVENT_KINDS if each == event), None)
        if kind is None:
            terminal.fail(f"--event takes {' or '.join(EVENT_KINDS)}, not {event}", terminal.WRONG_INPUT, as_json)
        if not 0.0 < confidence < 1.0:
            terminal.fail(
                f"--confidence is between 0 and 1, such as 0.95, not {confidence:g}", terminal.WRONG_INPUT, as_json
            )
        with terminal.progress_shown("repeats", not as_json) as shown:
            found = estimate(
                scenario,
                specification,
                _numbers(levels, as_json),
                event=kind,
                trials=trials,
                repeats=repeats,
                changes=overrides,
                seed=seed,
                confidence=confidence,
                jobs=terminal.job_count(jobs),
                on_progress=shown,
            )
    if as_json:
        terminal.print_json(found.to_json())
    else:
        terminal.say("\n".join(_lines(found)))


def _numbers(text: str | None, as_json: bool) -> Sequence[float] | None:
    if text is None or text == "none":
        return None if text is None else ()
    try:
        return [float(each) for each in text.split(",")]
    except ValueError:
        terminal.fail(f"--levels takes numbers such as `3,2,1`, or `none`, not {text}", terminal.WRONG_INPUT, as_json)


def _lines(found: RareEventEstimate) -> Iterator[str]:
    plan, probability = found.plan, found.probability
    event = plan.event
    yield f"{plan.scenario}: {event.specification} is {event.kind} with a probability of about {probability.value:.4g}"
    if probability.value > 0.0:
        interval = f"{probability.lower:.4g} to {probability.upper:.4g}"
        yield f"  {'interval':<12} {interval}, with confidence {probability.confidence:g} ({probability.method})"
    else:
        yield f"  {'interval':<12} none: no repeat came to the event, so all that is known is that it was not seen"
    repeats = f"{len(found.repeats):,} repeats of {plan.trials:,} trials a stage"
    yield f"  {'estimated by':<12} splitting: {repeats}, seed {plan.seed}"
    if found.pilot is not None:
        chosen = ",".join(f"{level!r}" for level in event.levels) or "none"
        yield f"  {'levels':<12} by a pilot of {found.pilot.steps:,} steps; to use them again: --levels={chosen}"
    for number, share in enumerate(found.shares):
        last = number == event.stages - 1
        end = event.kind if last else f"{event.levels[number]:g}"
        yield f"  {'to ' + end:<12} {share:.4g} of the trials"
    if found.missed and probability.value > 0.0:
        yield f"  {'never there':<12} {found.missed:,} repeats, which count as 0"
    if found.failed:
        yield f"  {'failed':<12} {found.failed:,} trials, which count as not coming closer"
    yield f"  {'steps':<12} {found.steps:,}"
