"""``symaware plot``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from symaware_cli.api import size_in_words
from symaware_cli.cli import terminal
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.views import PaperPreset

Title = Annotated[str | None, typer.Option(help="Title of the figure.")]
Size = Annotated[str | None, typer.Option(help="Width and height in inches, such as 12x8.", metavar="WxH")]
Resolution = Annotated[int, typer.Option("--dpi", min=20, max=1200, help="Dots per inch.")]


class Look(NamedTuple):
    """How a figure looks: its title, its size [inch], dots per inch, and a preset."""

    title: str | None
    size: tuple[float, float] | None
    dpi: int
    preset: PaperPreset | None


@in_help("look", 50)
def plot(
    path: Annotated[Path, typer.Argument(help="A log, or the folder of a sweep.", metavar="LOG")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The figure, .png, .svg, .pdf or .pgf; replaced if it exists. By default NAME.png, or NAME-2.png, ...",
        ),
    ] = None,
    show: Annotated[
        str | None,
        typer.Option(
            help="The panels, separated by commas: trajectories, separation, specifications, offers, risk, speed, "
            "altitude, control, or a part of awareness; of a sweep, metrics such as satisfied.safe or closest. By "
            "default those that fit the log, or differ from run to run.",
            metavar="PANELS",
        ),
    ] = None,
    series: Annotated[
        list[str] | None,
        typer.Option(
            help="A series to plot, such as `robot.0:state:heading` or `robot:risk`, of an agent, a group or an "
            "entity; may be repeated. The fields: state, world, applied_control, requested_control, intent, "
            "uncertainty, risk, and further parts of awareness.",
            metavar="NAME:FIELD[:COLUMN]",
        ),
    ] = None,
    agents: Annotated[
        str | None,
        typer.Option(help="Plot only these agents or groups, separated by commas."),
    ] = None,
    start: Annotated[float | None, typer.Option("--from", help="The first simulated time, in seconds.")] = None,
    end: Annotated[float | None, typer.Option("--to", help="The last simulated time, in seconds.")] = None,
    at: Annotated[
        float | None,
        typer.Option("--at", help="Show bodies and intents at this time, in seconds; by default the last."),
    ] = None,
    title: Title = None,
    size: Size = None,
    dpi: Resolution = 150,
    preset: Annotated[
        str | None,
        typer.Option(
            help="Width, font and colours for a paper: ieee-column, ieee-page, acm-column, acm-page or lncs.",
            metavar="NAME",
        ),
    ] = None,
    as_json: terminal.Json = False,
) -> None:
    """Plot a log in one figure: trajectories, separation, risk, or any series by name; or the results of a sweep."""
    if terminal.is_sweep(path):
        for option, value in {
            "--series": series,
            "--agents": agents,
            "--from": start,
            "--to": end,
            "--at": at,
        }.items():
            if value not in (None, []):
                terminal.fail(f"{option} goes with a log, and {path} is a folder", terminal.WRONG_INPUT, as_json)
        look = Look(title, _measures(size, as_json=as_json), dpi, _preset(preset, as_json=as_json))
        _plot_sweep(path, output, terminal.names(show), look, as_json=as_json)
        return
    terminal.span(start, end, as_json)
    terminal.instant("--at", at, as_json)
    measures = _measures(size, as_json=as_json)
    with terminal.trouble_shown(as_json):
        from symaware_cli.language import unused_path
        from symaware_cli.log import open_log
        from symaware_cli.views import PlotRequest, SeriesName, plot

        request = PlotRequest(
            show=tuple(terminal.names(show)),
            series=tuple(SeriesName.parse(name) for name in series or ()),
            agents=tuple(terminal.names(agents)),
            start=start,
            end=end,
            at=at,
            title=title,
            size=measures,
            dpi=dpi,
            preset=_preset(preset, as_json=as_json),
        )
        log = open_log(path)
        file = output or unused_path(path.stem, suffix=".png")
        content = plot(log, file, request)
    damage = str(log.damage) if log.damage and log.damage.lost else None
    facts = {"log": str(path), "file": str(file), "size": file.stat().st_size, **content.facts(), "damage": damage}
    if as_json:
        terminal.print_json(facts)
    else:
        terminal.say(_text(facts))
    if damage:
        terminal.say(f"symaware: {damage}", err=True)
        raise typer.Exit(terminal.DATA_LOST)


def _preset(name: str | None, *, as_json: bool) -> PaperPreset | None:
    """Return the preset of a name; exit if there is none."""
    from symaware_cli.views import PRESETS

    if name is not None and name not in PRESETS:
        terminal.fail(f"--preset is one of {', '.join(PRESETS)}, not {name!r}", terminal.WRONG_INPUT, as_json)
    return PRESETS[name] if name else None


def _plot_sweep(
    folder: Path,
    output: Path | None,
    show: list[str],
    look: Look,
    *,
    as_json: bool,
) -> None:
    with terminal.trouble_shown(as_json):
        from symaware_cli.language import unused_path
        from symaware_cli.studies import plot_sweep

        file = output or unused_path(folder.resolve().name, suffix=".png")
        picture = plot_sweep(folder, file, show, *look)
    runs = picture.runs
    panels = [{"panel": each.metric.name, "kind": each.kind, "of": each.caption} for each in picture.panels]
    facts: dict[str, Any] = {
        "sweep": str(folder),
        "file": str(file),
        "size": file.stat().st_size,
        "runs": len(runs.indices),
        "planned": runs.planned,
        "failed": runs.failed,
        "panels": panels,
        "notes": list(picture.notes),
    }
    if as_json:
        terminal.print_json(facts)
        return
    shown = ", ".join(dict.fromkeys(each.metric.name for each in picture.panels))
    terminal.say(f"{file}: {shown}; {size_in_words(facts['size'])}")
    failed = f", {runs.failed:,} of them failed or lost" if runs.failed else ""
    terminal.say(_line("runs", f"{len(runs.indices):,}{failed}"))
    for note in picture.notes:
        terminal.say(_line("note", note))


@in_help("look", 55)
def trajectories(
    folder: Annotated[Path, typer.Argument(help="The folder of a sweep.", metavar="DIR")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The figure, .png, .svg, .pdf or .pgf; replaced if it exists. By default NAME-trajectories.png.",
        ),
    ] = None,
    runs: Annotated[
        int | None,
        typer.Option(min=1, help="How many runs of each combination; by default 1,000 among all of them."),
    ] = None,
    title: Title = None,
    size: Size = None,
    dpi: Resolution = 150,
    as_json: terminal.Json = False,
) -> None:
    """Plot the paths of the runs of a sweep over the map, those that violate a specification in red.

    The runs are repeated for this, so that the sweep need not keep their logs.
    """
    measures = _measures(size, as_json=as_json)
    with terminal.trouble_shown(as_json):
        from symaware_cli.language import unused_path
        from symaware_cli.studies import plot_paths

        file = output or unused_path(f"{folder.resolve().name}-trajectories", suffix=".png")
        with terminal.progress_shown("runs made again", not as_json) as tell:
            picture = plot_paths(folder, file, runs, title, measures, dpi, tell)
    panels: list[dict[str, Any]] = [
        {"of": panel.caption, "runs": len(panel.paths), "violating": sum(panel.violated)} for panel in picture.panels
    ]
    facts: dict[str, Any] = {
        "sweep": str(folder),
        "file": str(file),
        "size": file.stat().st_size,
        "runs": picture.runs,
        "panels": panels,
        "notes": list(picture.notes),
    }
    if as_json:
        terminal.print_json(facts)
        return
    terminal.say(f"{file}: trajectories; {size_in_words(facts['size'])}")
    violating = sum(panel["violating"] for panel in panels)
    said = f", {violating:,} of them violate a specification" if picture.specifications else ""
    terminal.say(_line("runs", f"{picture.runs:,}{said}"))
    for note in picture.notes:
        terminal.say(_line("note", note))


def _measures(size: str | None, *, as_json: bool) -> tuple[float, float] | None:
    if size is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d*)?)\s*[x×]\s*(\d+(?:\.\d*)?)", size.strip())
    if not found:
        terminal.fail(
            f"--size takes width and height in inches, such as 12x8, not {size!r}", terminal.WRONG_INPUT, as_json
        )
    return float(found[1]), float(found[2])


def _text(facts: dict[str, Any]) -> str:
    """Lay out the contents of a figure as text."""
    lines = [
        f"{facts['file']}: {', '.join(panel['panel'] for panel in facts['panels'])}; {size_in_words(facts['size'])}",
        _line("agents", f"{facts['agents']:,}, {facts['start']:g} to {facts['end']:g} s"),
    ]
    for panel in facts["panels"]:
        if panel["panel"] == "separation":
            least = [panel[which] for which in ("agents", "obstacles") if panel.get(which)]
            lines += [_line("closest", f"{each['minimum']:.3g} m, {_told(each)}") for each in least]
        elif panel["panel"] == "risk" and panel.get("maximum"):
            lines.append(_line("highest risk", f"{panel['maximum']['value']:.3g}, {_told(panel['maximum'])}"))
    return "\n".join([*lines, *(_line("note", note) for note in facts["notes"])])


def _told(extreme: dict[str, Any]) -> str:
    return f"{' and '.join(extreme['who'])} at {extreme['time']:.9g} s"


def _line(label: str, text: str) -> str:
    return f"  {label:<13} {text}"
