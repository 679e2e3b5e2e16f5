"""``symaware explain``."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli import terminal
from symaware_cli.cli.folding import folded
from symaware_cli.cli.streams import width_of
from symaware_cli.cli.text_table import aligned
from symaware_cli.help_place import in_help
from symaware_cli.world import counted

if TYPE_CHECKING:
    from symaware_cli.evidence import Candidate, CandidateRow, Explanation, ExplanationPlan, FutureComparison

#: Candidates that are shown, at most.
_MOST = 20


@in_help("check", 60)
def explain(
    log: Annotated[Path, typer.Argument(help="The log of a run that violated a specification.", metavar="LOG")],
    specification: Annotated[
        str | None,
        typer.Option("--specification", help="The specification; by default the one violated first.", metavar="NAME"),
    ] = None,
    kinds: Annotated[
        str,
        typer.Option(
            help="What may be a cause: beliefs, messages, declared faults, broken promises, or components (--over).",
            metavar="KIND,...",
        ),
    ] = "beliefs,messages,faults,promises,components",
    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            help="Alternatives of a component that may be a cause: `agents.cart.components.see.use=perception.range`, "
            "or of a parameter of one; may be repeated.",
            metavar="PATH=VALUES",
        ),
    ] = None,
    agents: Annotated[
        str,
        typer.Option(
            help="Whose beliefs and received messages: an id or a pattern, such as `robot.*`.", metavar="PATTERN"
        ),
    ] = "*",
    before: Annotated[
        str,
        typer.Option(help="How long before the violation these are made right [s].", metavar="SECONDS,..."),
    ] = "0.5,1,2,4",
    futures: Annotated[
        int,
        typer.Option(
            min=16, max=100_000, help="The number of redrawn futures with a candidate made right, and with its placebo."
        ),
    ] = 32,
    within: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1e6,
            help="Run branches until this long after the violation [s]; by default to the end of the run.",
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(
            min=0.0, max=1e9, help="The most CPU time of the branches [s]; fewer futures are drawn to keep it."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of the redrawn futures.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="A picture of what mattered, and when.", metavar="FILE"),
    ] = None,
    trust: terminal.Trust = False,
    as_json: terminal.Json = False,
) -> None:
    """Find what would have prevented a violation: a true belief, messages in time, no fault, another component..."""
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import KINDS, draw_timeline, require_timeline_format
        from symaware_cli.evidence import explain as explained

        try:
            grid = [float(each) for each in before.split(",")]
        except ValueError:
            grid = []
        if not grid or not all(0.0 < each < 1e9 for each in grid):
            terminal.fail(
                f"--before {before}: expected positive times [s], as in 0.5,1,2", terminal.WRONG_INPUT, as_json
            )
        chosen = [each.strip() for each in kinds.split(",")]
        if not set(chosen) <= set(KINDS):
            terminal.fail(f"--kinds {kinds}: expected some of {','.join(KINDS)}", terminal.WRONG_INPUT, as_json)
        if output is not None:
            require_timeline_format(output)
        with terminal.progress_shown("branches", not as_json) as shown:
            found = explained(
                log,
                specification,
                kinds=chosen,
                agents=agents,
                before=grid,
                futures=futures,
                within=within,
                budget=budget,
                seed=seed,
                over=over or (),
                on_plan=None if as_json else _announce,
                on_progress=shown,
            )
        if output is not None:
            draw_timeline(found, output)
    if as_json:
        terminal.print_json(found.to_json())
    else:
        terminal.say("\n".join(_lines(found, output)))
    sys.stdout.flush()


def _announce(plan: ExplanationPlan) -> None:
    """Print the expected cost to the standard error, because the time differs from machine to machine."""
    size = f"{counted(plan.candidates, 'candidate')}, {counted(len(plan.instants), 'instant')}"
    terminal.say(
        f"at most {plan.branches:,} branches, about {plan.cpu_time:.0f} s of CPU time ({size}, {plan.futures} futures)",
        err=True,
    )


def _lines(found: Explanation, output: Path | None) -> Iterator[str]:
    from symaware_cli.evidence import strongest

    yield f"{found.log}: {terminal.printable(found.text)}"
    best = strongest(found.everything)
    is_about_beliefs = list(found.kinds) == ["beliefs"]
    treatment = "truth" if is_about_beliefs else "making all right"
    yield f"  {'all at once':<12} {_shares(best, treatment, 'the placebo')}, from {best.instant:g} s on"
    if not found.is_among_candidates:
        why = "save no more futures than their placebos" if best.has_placebo else "save too few futures"
        yield f"  {'cause':<12} none in {found.where}: all at once {why}"
    elif not found.causes:
        which = "none that was compared" if found.uncompared else "none"
        yield f"  {'cause':<12} in {found.where}, but no single one: {which} saves more futures than its placebo"
    for each in found.causes:
        assert each.best is not None
        yield f"  {'cause':<12} {_cause([each.candidate], each.best)}"
        yield f"  {'to repeat':<12} {terminal.printable(each.command)}"
    if found.together is not None:
        yield f"  {'together':<12} {_cause(found.together.candidates, found.together.test)}"
        yield f"  {'to repeat':<12} {terminal.printable(found.together.command)}"
    if found.uncompared:
        compared = sum(bool(each.tests) for each in found.rows)
        left = compared + len(found.uncompared)
        yield f"  {'screening':<12} left {left}; only the strongest ({compared}) were compared"
    for passed in found.over:
        yield f"  {'not tried':<12} {terminal.printable(passed.text)}, {passed.passed}: see --before"
    if found.rows:
        yield ""
        head = "belief" if is_about_beliefs else "candidate"
        heads = [head, *(f"{each:g} s" for each in found.plan.instants), "in general", "at least"]
        lines = [heads, *(_cells(each, len(found.plan.instants)) for each in found.rows[:_MOST])]
        for line in aligned(lines, "<" + "<" * len(found.plan.instants) + ">>", indent="  "):
            yield terminal.printable(line)
        if len(found.rows) > _MOST:
            yield f"  and {len(found.rows) - _MOST:,} more (--json)"
        yield ""
        what = "the truth" if is_about_beliefs else "this"
        # A paragraph, which is never a single line.
        yield folded(
            f"  `saved`: {found.made_right} from then on, it prevents the violation of this run. In general: the share "
            f"of redrawn futures that {what} saves minus that of the placebo, and its lower bound: with confidence "
            f"{found.confidence:g}, it is above 0 only for causes",
            width_of() or 100,
        )
    yield f"  {'branches':<12} {found.branches:,}"
    if output is not None:
        yield f"  {'picture':<12} {output}"


def _cause(candidates: Sequence[Candidate], test: FutureComparison) -> str:
    one = candidates[0]
    treatment, control = (one.treatment, one.control) if len(candidates) == 1 else ("making them right", "the placebo")
    names = ", and ".join(terminal.printable(each.text) for each in candidates)
    return f"{names}: {_shares(test, treatment, control)}, from {test.instant:g} s on"


def _shares(test: FutureComparison, treatment: str, control: str) -> str:
    shares = test.shares
    right, placebo = shares.first + shares.both, shares.second + shares.both
    if not test.has_placebo:
        return f"{treatment} saves only {right} of {shares.trials} futures"
    return f"{treatment} saves {right} of {shares.trials} futures, {control} {placebo}"


def _cells(row: CandidateRow, count: int) -> list[str]:
    run = ["saved" if each else "-" for each in row.in_this_run] or [""] * count
    best = row.best
    if best is None or not best.has_placebo:
        return [row.candidate.text, *run, "not compared" if row.is_uncompared else "-", "-"]
    return [row.candidate.text, *run, f"{best.shares.difference:+.0%}", f"{best.lower:+.0%}"]
