"""The Rerun viewer as a process: on the screen, in a browser, or without either for pictures."""

from __future__ import annotations

import ipaddress
import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, urlsplit

import numpy as np

from symaware_cli.recording.error import LogError
from symaware_cli.viewing.rerun.columns import TIMELINE

if TYPE_CHECKING:
    from rerun.experimental import View, ViewerClient

#: How long a viewer may take to listen [s].
_PATIENCE = 30.0
#: How long it may take to load a recording for a picture [s].
_LOADING = 600.0
#: How long a picture may take to come to rest [s], and how often in a row it must be the same.
_SETTLING = 20.0
_STILL = 3
#: Where Rerun serves its viewer for browsers, unless told otherwise.
WEB_PORT = 9090

#: What a server for browsers of Rerun 0.41 prints as soon as it listens for recordings, and for browsers.
_LISTENS = re.compile(r"Listening for gRPC connections on \S+:(\d+)\.")
_SERVES = re.compile(r"Hosting a web-viewer at http://\S+:(\d+) ")


_NO_ADDRESS = "this machine does not have the address to listen on; choose one with --bind"
_LATE = f"the viewer did not come up within {_PATIENCE:g} s"


class ViewerError(Exception):
    """The viewer did not do what it was asked to."""


@dataclass(frozen=True)
class Viewer:
    """A viewer that runs.

    Attributes:
        process: Its process, a child of this one.
        url: Where recordings are sent to.
        link: What a browser opens; empty if it is not for browsers.
    """

    process: subprocess.Popen[bytes]
    url: str
    link: str = ""

    @property
    def closed(self) -> bool:
        """Whether somebody closed it."""
        return self.process.poll() is not None

    def wait(self) -> None:
        """Wait until somebody closes it."""
        self.process.wait()


def require() -> None:
    """Make sure that Rerun is installed.

    Raises:
        LogError: It is not, or it is another than the one this was made for.
    """
    # Whatever Rerun's own threads meet reaches us as an exception, and is told in our words.
    os.environ.setdefault("RUST_LOG", "off")
    try:
        version = metadata.version("rerun-sdk")
    except metadata.PackageNotFoundError:
        raise LogError("replays need Rerun: pip install 'symaware-cli[viewer]'") from None
    if version.split(".")[:2] != ["0", "41"]:
        raise LogError(f"replays need Rerun 0.41, not {version}: pip install 'symaware-cli[viewer]'")


@contextmanager
def viewer(
    *, headless: bool = False, web: bool = False, bind: str = "127.0.0.1", web_port: int = WEB_PORT, size: str = ""
) -> Iterator[Viewer]:
    """Start a viewer, which ends with the block.

    It keeps to itself: it neither reads nor writes anything in the user's home, and its usage statistics are off.

    Args:
        headless: Without a window, for pictures.
        web: For browsers.
        bind: The address it listens on.
        web_port: Where it serves browsers; 0 for any free port.
        size: Of the window, such as ``1600x1000``.

    Raises:
        ViewerError: It does not come up, and what it said.
    """
    # What a windowed viewer prints it also shows, so that its port has to be known beforehand.
    port = "auto" if web else str(_free_port(bind))
    command = [str(_executable()), "--bind", bind, "--port", port, "--hide-welcome-screen"]
    if headless:
        command.append("--headless")
    if web:
        # The server forgets the beginning of what exceeds its memory, by default 1 GiB.
        command += ["--serve-web", "--web-viewer-port", str(web_port), "--server-memory-limit", "75%"]
        if not ipaddress.ip_address(bind).is_loopback:
            # Other machines know this one by names of their own; its page is at the same port for all.
            command += ["--cors-allow-origin", f"http://*:{web_port}"]
    if size:
        command += ["--window-size", size]
    with tempfile.TemporaryDirectory(prefix="symaware-viewer-", ignore_cleanup_errors=True) as home:
        said = Path(home) / "said"
        with open(said, "wb") as output:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                # Not a pipe, which would block the viewer as soon as it is full.
                stdout=output,
                stderr=subprocess.STDOUT,
                env=_environment(Path(home), web),
                # Ctrl-C reaches this process alone, which then ends the viewer.
                start_new_session=True,
                preexec_fn=_die_with_parent(),
            )
        try:
            if web:
                url = _url(bind, _await_words(process, said, _LISTENS))
                page = f"http://{_reachable(bind)}:{_await_words(process, said, _SERVES)}/"
                # Its welcome would ask the network for examples; the scene is dark, so what is around it is, too.
                link = f"{page}?url={quote(url, safe='')}&hide_welcome_screen=1&theme=dark"
            else:
                url, link = _url(bind, port), ""
                _await_answer(process, said, url)
            try:
                yield Viewer(process, url, link)
            except ViewerError as error:
                raise ViewerError(_said(said) or str(error)) from error
        finally:
            _end(process)


def picture(
    recording: Path, moment: int | None, size: str = "1600x1000", timeline: str = TIMELINE
) -> tuple[bytes, list[View]]:
    """Take a picture of a recording without a screen.

    Args:
        recording: An .rrd file, with its blueprint.
        moment: The instant [ns]; None for wherever the viewer begins.
        size: Width and height in pixels, such as ``1600x1000``.
        timeline: On which the instant is.

    Returns:
        A PNG, and the views with what they report.

    Raises:
        ViewerError: There is no graphics driver, or the viewer failed.
    """
    from rerun.experimental import ViewerClient

    with viewer(headless=True, size=size) as running:
        try:
            client = ViewerClient.connect(running.url)
            client.open([str(recording)])
            deadline = time.monotonic() + _LOADING
            while client.get_state().loading:
                if time.monotonic() > deadline:
                    raise ViewerError(f"the viewer did not load the recording within {_LOADING:g} s")
                time.sleep(0.05)
            if moment is not None:
                client.set_time(timeline, duration=np.timedelta64(moment, "ns"), play_state="paused")
            return _settled(client), client.get_state().views
        except (RuntimeError, ValueError, OSError) as error:
            raise ViewerError(f"the viewer failed: {error}") from error


def require_reachable(url: str) -> None:
    """Make sure that somebody listens where a viewer is said to be; Rerun would wait for it without end.

    Raises:
        ViewerError: Nobody does, or the URL is not one of a viewer.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port or parts.scheme not in ("rerun", "rerun+http", "rerun+https") or parts.path != "/proxy":
        raise ViewerError(f"{url} is not the URL of a viewer, such as rerun+http://127.0.0.1:9876/proxy")
    try:
        socket.create_connection((host, port), _PATIENCE / 6).close()
    except OSError as error:
        raise ViewerError(f"the viewer at {url} cannot be reached: {(error.strerror or str(error)).lower()}") from None


def _settled(client: ViewerClient) -> bytes:
    """The picture once nothing moves any more: axes of plots glide to where they belong."""
    deadline, still = time.monotonic() + _SETTLING, 1
    shown: bytes = client.take_screenshot()
    while still < _STILL and time.monotonic() < deadline:
        time.sleep(0.15)
        before, shown = shown, client.take_screenshot()
        still = still + 1 if shown == before else 1
    return shown


def _executable() -> Path:
    """The viewer itself: the command ``rerun`` is a wrapper, whose child would survive it."""
    import rerun_cli

    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    return Path(rerun_cli.__file__).with_name(name)


def _environment(home: Path, talkative: bool) -> dict[str, str]:
    """The environment of a viewer, which finds its settings in a folder of its own."""
    settings = home / "rerun" / "analytics.json"
    settings.parent.mkdir()
    data = home / "rerun" / "analytics"
    # Statistics are off only in a file with all of these.
    content = {"analytics_enabled": False, "analytics_id": "none", "metadata": {}}
    content |= {"config_file_path": str(settings), "data_dir_path": str(data)}
    settings.write_text(json.dumps(content))
    folders = {"XDG_CONFIG_HOME": str(home), "XDG_DATA_HOME": str(home), "XDG_CACHE_HOME": str(home)}
    levels = "error,re_grpc_server=info,re_sdk::web_viewer=info" if talkative else "error"
    return {**os.environ, **folders, "RERUN_APP_ONLY": "true", "RUST_LOG": levels, "NO_COLOR": "1"}


def _await_words(process: subprocess.Popen[bytes], said: Path, announced: re.Pattern[str]) -> str:
    """Wait until the viewer announces something, and return what of it the pattern picks.

    Raises:
        ViewerError: It ended, or does not come up.
    """
    for ended in _moments(process):
        if found := announced.search(said.read_text(errors="replace")):
            return found[1]
        if ended:
            raise ViewerError(_reason(_said(said)))
    raise ViewerError(_LATE)


def _await_answer(process: subprocess.Popen[bytes], said: Path, url: str) -> None:
    """Wait until the viewer answers, which it does as soon as it draws.

    Raises:
        ViewerError: It ended, or does not come up.
    """
    from rerun.experimental import ViewerClient

    for ended in _moments(process):
        if ended:
            raise ViewerError(_reason(_said(said)))
        try:
            ViewerClient.connect(url).get_state()
        except (RuntimeError, ValueError, OSError):
            continue
        return
    raise ViewerError(_LATE)


def _moments(process: subprocess.Popen[bytes]) -> Iterator[bool]:
    """Whether a process has ended, now and then for as long as patience lasts."""
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline:
        yield process.poll() is not None
        time.sleep(0.02)


def _reason(said: str) -> str:
    if "graphics adapter" in said or "winit" in said or "DISPLAY" in said:
        return (
            "the viewer found no screen or graphics driver; --web shows the replay in a browser, --save keeps it for "
            "another machine, and Debian's mesa-vulkan-drivers is enough for --screenshot"
        )
    if "Address already in use" in said:
        return "the port is taken by another program; choose one with --port"
    if "Cannot assign requested address" in said:
        return _NO_ADDRESS
    return f"the viewer ended at once: {said or 'it said nothing'}"


def _said(said: Path) -> str:
    """What a viewer complained about."""
    lines = said.read_text(errors="replace").splitlines()
    return "\n".join(line for line in lines if " INFO " not in line and "XDG_RUNTIME_DIR" not in line)[-2000:].strip()


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(3.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _free_port(bind: str) -> int:
    with socket.socket(socket.AF_INET6 if ":" in bind else socket.AF_INET) as probe:
        try:
            probe.bind((bind, 0))
        except OSError:
            raise ViewerError(_NO_ADDRESS) from None
        port: int = probe.getsockname()[1]
        return port


def _url(bind: str, port: str) -> str:
    """Where a viewer takes recordings."""
    return f"rerun+http://{_reachable(bind)}:{port}/proxy"


def _reachable(bind: str) -> str:
    """Where to reach something on this machine that listens on an address."""
    if bind in ("0.0.0.0", "::"):
        return "127.0.0.1"
    return f"[{bind}]" if ":" in bind else bind


def _die_with_parent() -> Callable[[], object] | None:
    """What asks Linux, in a child, to end it when its parent dies, even of kill -9."""
    if sys.platform != "linux":
        return None
    import ctypes

    # Looked up before the fork, after which little is safe. 1 is PR_SET_PDEATHSIG.
    prctl, death = ctypes.CDLL(None).prctl, int(signal.SIGTERM)
    return lambda: prctl(1, death)
