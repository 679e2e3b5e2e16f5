"""``symaware replay``."""

from __future__ import annotations

import ipaddress
import signal
import sys
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from symaware_cli.api import size_in_words
from symaware_cli.api.progress import progress
from symaware_cli.cli import terminal
from symaware_cli.cli.streams import is_lively
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.log import Log
    from symaware_cli.views import ForeignReplaySession
    from symaware_cli.views.replay_session import ReplaySession


_WHERE, _WHAT, _PICTURE = "Where to show it", "What to show", "Picture"

#: The size of a picture, and of a video, unless another is asked for.
_SIZE, _VIDEO_SIZE = "1600x1000", "800x600"

#: From where a scene may be seen.
_VIEWS = ("above", "angle", "front", "side")

#: The least and greatest width and height of a picture [pixels].
_SMALLEST, _LARGEST = 200, 8192


@in_help("look", 40)
def replay(
    path: Annotated[Path, typer.Argument(help="A log.", metavar="LOG")],
    save: Annotated[
        Path | None,
        typer.Option(
            "--save", help="Write an .rrd file for any Rerun viewer instead of opening one.", rich_help_panel=_WHERE
        ),
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option("--screenshot", help="Write a PNG of the viewer; needs no screen.", rich_help_panel=_PICTURE),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            "--video",
            help="Write a moving picture of the scene, .gif, .webp or .mp4; needs neither a screen nor Rerun.",
            rich_help_panel=_PICTURE,
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            "--speed",
            help="Simulated seconds per second of --video; by default 1, or what makes it last 20 s.",
            rich_help_panel=_PICTURE,
        ),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            "--view",
            help="From where the scene is seen: above, angle, front or side; by default from above if it is planar.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    theme: Annotated[
        str | None,
        typer.Option(
            "--theme",
            help="The colours of the scene: light or dark; by default dark in the viewer, light in a video.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(
            "--at", help="Time of the screenshot, in seconds; by default the middle.", rich_help_panel=_PICTURE
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            "--size",
            help="Width and height of the picture, by default 1600x1000, and 800x600 of a video.",
            metavar="WxH",
            rich_help_panel=_PICTURE,
        ),
    ] = None,
    web: Annotated[
        bool, typer.Option("--web", help="Serve the viewer to browsers and print the link.", rich_help_panel=_WHERE)
    ] = False,
    port: Annotated[
        int | None,
        typer.Option("--port", min=1, max=65535, help="The port of --web, by default 9090.", rich_help_panel=_WHERE),
    ] = None,
    bind: Annotated[
        str | None,
        typer.Option(
            "--bind",
            help="The address to listen on; by default 127.0.0.1; 0.0.0.0 for access from other machines.",
            rich_help_panel=_WHERE,
        ),
    ] = None,
    connect: Annotated[
        str | None,
        typer.Option("--connect", help="Send to a running viewer.", metavar="URL", rich_help_panel=_WHERE),
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", help="Show a log while it is still being written.", rich_help_panel=_WHAT)
    ] = False,
    agents: Annotated[
        str | None,
        typer.Option(
            "--agents", help="Agents to show in detail: ids or groups, separated by commas.", rich_help_panel=_WHAT
        ),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            "--against",
            help="A second log to show beside it: its bodies in grey.",
            metavar="LOG",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    start: Annotated[
        float | None, typer.Option("--from", help="The first simulated time, in seconds.", rich_help_panel=_WHAT)
    ] = None,
    end: Annotated[
        float | None, typer.Option("--to", help="The last simulated time, in seconds.", rich_help_panel=_WHAT)
    ] = None,
    as_json: terminal.Json = False,
) -> None:
    """Show a log in the Rerun viewer: motion, beliefs, intents, risks and messages of all agents."""
    ways, is_part = (save, screenshot, video, web, connect), against is not None or start is not None or end is not None
    whole = "leave out --save, --screenshot, --video, --against, --from and --to"
    named = "end the name of the file in"
    reasons = (
        (sum(map(bool, ways)) > 1, "choose one of --save, --screenshot, --video, --web and --connect"),
        (follow and bool(save or screenshot or video or is_part), f"--follow shows a whole log in a viewer; {whole}"),
        (_ends_otherwise(save, ".rrd"), f"--save writes a recording of Rerun; {named} .rrd, not {save}"),
        (_ends_otherwise(screenshot, ".png"), f"--screenshot writes a PNG; {named} .png, not {screenshot}"),
        (at is not None and not screenshot, "--at goes with --screenshot"),
        (size is not None and not (screenshot or video), "--size goes with --screenshot or --video"),
        (speed is not None and not video, "--speed goes with --video"),
        (speed is not None and not 0.01 <= speed <= 1e6, "--speed is a number from 0.01 to a million"),
        (theme not in (None, "light", "dark"), f"--theme is light or dark, not {theme}"),
        (view not in (None, *_VIEWS), f"--view is one of {', '.join(_VIEWS)}, not {view}"),
        (port is not None and not web, "--port is the port of --web"),
        (
            bind is not None and bool(save or screenshot or video or connect),
            "--bind goes with --web, or with a viewer of its own",
        ),
    )
    terminal.refuse(reasons, as_json)
    first, last = terminal.span(start, end, as_json)
    moment = terminal.instant("--at", at, as_json)
    size, bind, port = size or (_VIDEO_SIZE if video else _SIZE), bind or "127.0.0.1", port or 9090
    _require_sound(size, bind, as_json=as_json)
    bar = is_lively(sys.stderr) and not as_json
    facts: dict[str, object] = {"log": str(path)}
    with terminal.trouble_shown(as_json):
        from symaware_cli.views.viewer import ViewerError, require

        if not video:
            require()
        log = _opened(path, follow=follow)
        if log.foreign and (agents or is_part or view or video or theme):
            options = "--agents, --against, --from, --to, --view, --theme and --video"
            terminal.fail(f"{path} was not written by SymAware; leave out {options}", terminal.WRONG_INPUT, as_json)
        _require_shown(moment, log, first, last, as_json=as_json)
        shown = _replay_session(log, terminal.names(agents), first, last, against, view, theme)
        facts["shown"] = shown.words
        try:
            if video:
                _film(shown, video, VideoOptions(speed, size, view, theme), facts, bar=bar, as_json=as_json)
            elif file := save or screenshot:
                with progress(path.name, log.start_time or 0, log.end_time or 0, bar) as on_progress:
                    if save:
                        shown.save(file, on_progress)
                    else:
                        views = shown.picture(file, moment, size, on_progress)
                        facts["reports"] = [f"{view.name}: {each.summary}" for view in views for each in view.reports]
                _tell({**facts, "file": str(file), "size": file.stat().st_size}, as_json=as_json)
            else:
                _present(
                    shown,
                    facts,
                    web=web,
                    bind=bind,
                    port=port,
                    connect=connect,
                    follow=follow,
                    bar=bar,
                    as_json=as_json,
                )
        except ViewerError as error:
            terminal.fail(str(error), terminal.FAILED, as_json)
    # A log that is still being written has no end yet.
    if not follow and log.damage and log.damage.lost:
        terminal.say(f"symaware: {log.damage}", err=True)
        raise typer.Exit(terminal.DATA_LOST)


class VideoOptions(NamedTuple):
    """The options of a video, as they were given."""

    speed: float | None
    size: str
    view: str | None
    theme: str | None


def _film(
    shown: ReplaySession | ForeignReplaySession,
    file: Path,
    options: VideoOptions,
    facts: dict[str, object],
    *,
    bar: bool,
    as_json: bool,
) -> None:
    """Write a video, and print its properties."""
    from symaware_cli.views import THEMES, ForeignReplaySession, VideoRequest, write_replay

    assert not isinstance(shown, ForeignReplaySession)
    width, _, height = options.size.partition("x")
    request = VideoRequest(
        options.speed, (int(width), int(height)), options.view or "", THEMES[options.theme or "light"]
    )
    with progress(file.name, *shown.span, bar) as on_progress:
        film = write_replay(shown, file, request, on_progress)
    facts |= {"frames": len(film.moments), "speed": film.speed, "video": film.words}
    _tell({**facts, "file": str(file), "size": file.stat().st_size}, as_json=as_json)


def _replay_session(
    log: Log,
    agents: Sequence[str],
    first: int | None,
    last: int | None,
    against: Path | None,
    view: str | None,
    theme: str | None,
) -> ReplaySession | ForeignReplaySession:
    if log.foreign:
        from symaware_cli.views import ForeignReplaySession

        return ForeignReplaySession(log)
    from symaware_cli.views import THEMES
    from symaware_cli.views.replay_session import replay_session

    # Times are whole nanoseconds: the interval after the last one begins with the next.
    other = None if against is None else _opened(against, follow=False)
    return replay_session(
        log, agents, first, None if last is None else last + 1, other, view or "", THEMES[theme or "dark"]
    )


def _present(
    shown: ReplaySession | ForeignReplaySession,
    facts: dict[str, object],
    *,
    web: bool,
    bind: str,
    port: int,
    connect: str | None,
    follow: bool,
    bar: bool,
    as_json: bool,
) -> None:
    """Send everything to a viewer, and wait until it is closed or Ctrl-C is pressed."""
    from symaware_cli.views import viewer

    # The viewer ends with this process, however that ends.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    running = nullcontext() if connect else viewer.viewer(web=web, bind=bind, web_port=port)
    with running as started:
        url = connect or (started.url if started else "")
        if started and started.link:
            facts["link"] = started.link
        if follow:
            _tell(facts, as_json=as_json)
        try:
            if follow:
                recording = shown.follow(url, lambda: started is None or not started.closed)
            else:
                log = shown.log
                with progress(log.path.name, log.start_time or 0, log.end_time or 0, bar) as on_progress:
                    recording = shown.send(url, on_progress)
                _tell(facts, as_json=as_json)
        except viewer.ViewerError:
            if started and started.closed:
                # The viewer was closed.
                return
            raise
        if started:
            # Everything has been shown, so Ctrl-C is not an interruption.
            with suppress(KeyboardInterrupt):
                started.wait()
        del recording


def _ends_otherwise(file: Path | None, suffix: str) -> bool:
    return file is not None and file.suffix.lower() != suffix


def _require_sound(size: str, bind: str, *, as_json: bool) -> None:
    """Exit if the options are invalid."""
    width, _, height = size.partition("x")
    if not all(side.isdecimal() and len(side) < 6 and _SMALLEST <= int(side) <= _LARGEST for side in (width, height)):
        why = f"--size is two numbers of pixels from {_SMALLEST} to {_LARGEST}, such as 1600x1000, not {size!r}"
        terminal.fail(why, terminal.WRONG_INPUT, as_json)
    try:
        ipaddress.ip_address(bind)
    except ValueError:
        terminal.fail(
            f"--bind is an IP address, such as 127.0.0.1 or 0.0.0.0, not {bind!r}", terminal.WRONG_INPUT, as_json
        )


def _require_shown(moment: int | None, log: Log, first: int | None, last: int | None, *, as_json: bool) -> None:
    """Exit if the time of the picture [ns] is not within the times that are shown."""
    begin = max(time for time in (log.start_time, first, 0) if time is not None)
    end = min((time for time in (log.end_time, last) if time is not None), default=None)
    if moment is not None and end is not None and not begin <= moment <= end:
        what = f"{log.path}, of which {begin / 1e9:g} to {end / 1e9:g} s are shown"
        terminal.fail(f"--at {moment / 1e9:g} is not in {what}", terminal.WRONG_INPUT, as_json)


def _opened(path: Path, *, follow: bool) -> Log:
    if follow:
        from symaware_cli.views import await_beginning

        return await_beginning(path, lambda: True)
    from symaware_cli.log import open_log

    return open_log(path)


def _tell(facts: dict[str, object], *, as_json: bool) -> None:
    if as_json:
        terminal.print_json(facts)
        return
    if "file" in facts:
        terminal.say(f"{facts['file']}: {size_in_words(int(str(facts['size'])))}")
    if "link" in facts:
        terminal.say(f"{facts['link']}\nCtrl-C ends it.")
    if "video" in facts:
        terminal.say(f"  {facts['video']}")
    terminal.say(f"  {facts['shown']}")
    for report in facts.get("reports", ()):  # type: ignore[attr-defined]
        terminal.say(f"  {report}", err=True)
    # Flushed, so that a reader of a pipe receives it before the viewer is closed.
    sys.stdout.flush()
