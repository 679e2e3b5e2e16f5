"""Runs the Rerun viewer as a process: in a window, for browsers, or without a screen for pictures."""

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

from symaware_cli.log import LogError
from symaware_cli.views.rerun.columns import TIMELINE

if TYPE_CHECKING:
    from rerun.experimental import View, ViewerClient

#: Time limit for a viewer to start listening [s].
_TIMEOUT = 30.0
#: Time limit for loading a recording for a picture [s].
_LOADING = 600.0
#: Time limit for a picture to become stable [s], and the number of equal screenshots required.
_SETTLING = 20.0
_STILL = 3
#: Default port for browsers.
WEB_PORT = 9090

#: Output of the web server of Rerun 0.41 when it listens for recordings, and for browsers.
_LISTENS = re.compile(r"Listening for gRPC connections on \S+:(\d+)\.")
_SERVES = re.compile(r"Hosting a web-viewer at http://\S+:(\d+) ")


_NO_ADDRESS = "this machine does not have the address to listen on; choose one with --bind"
_TIMED_OUT = f"the viewer did not start within {_TIMEOUT:g} s"


class ViewerError(Exception):
    """The viewer failed."""


@dataclass(frozen=True)
class Viewer:
    """A running viewer.

    Attributes:
        process: Its process, a child of this one.
        url: The URL to send recordings to.
        link: The URL to open in a browser; empty if it is not for browsers.
    """

    process: subprocess.Popen[bytes]
    url: str
    link: str = ""

    @property
    def closed(self) -> bool:
        """Whether it was closed."""
        return self.process.poll() is not None

    def wait(self) -> None:
        """Wait until it is closed."""
        self.process.wait()


def require() -> None:
    """Check that Rerun is installed.

    Raises:
        LogError: It is not installed, or has an unsupported version.
    """
    # Errors in Rerun's threads reach this process as exceptions, so its own log output is redundant.
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
    """Start a viewer, which is ended with the block.

    It neither reads nor writes files in the user's home, and its usage statistics are off.

    Args:
        headless: Without a window, for pictures.
        web: For browsers.
        bind: The address to listen on.
        web_port: The port for browsers; 0 for any free port.
        size: The size of the window, such as ``1600x1000``.

    Raises:
        ViewerError: It does not start; the message has its output.
    """
    # A viewer with a window shows its output in the window as well, so its port must be chosen beforehand.
    port = "auto" if web else str(_free_port(bind))
    command = [str(_executable()), "--bind", bind, "--port", port, "--hide-welcome-screen"]
    if headless:
        command.append("--headless")
    if web:
        # The server drops the oldest data beyond its memory limit, 1 GiB by default.
        command += ["--serve-web", "--web-viewer-port", str(web_port), "--server-memory-limit", "75%"]
        if not ipaddress.ip_address(bind).is_loopback:
            # Other machines use other names for this one; the page has the same port for all.
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
                env=_environment(Path(home), verbose=web),
                # Ctrl-C is sent only to this process, which then ends the viewer.
                start_new_session=True,
                preexec_fn=_end_with_parent(),
            )
        try:
            if web:
                url = _url(bind, _await_output(process, said, _LISTENS))
                page = f"http://{_reachable(bind)}:{_await_output(process, said, _SERVES)}/"
                # Without the welcome screen, which would fetch examples from the network; dark, like the scene.
                link = f"{page}?url={quote(url, safe='')}&hide_welcome_screen=1&theme=dark"
            else:
                url, link = _url(bind, port), ""
                _await_answer(process, said, url)
            try:
                yield Viewer(process, url, link)
            except ViewerError as error:
                raise ViewerError(_error_output(said) or str(error)) from error
        finally:
            _end(process)


def picture(
    recording: Path, moment: int | None, size: str = "1600x1000", timeline: str = TIMELINE
) -> tuple[bytes, list[View]]:
    """Take a picture of a recording without a screen.

    Args:
        recording: An .rrd file, with its blueprint.
        moment: The instant [ns]; None for the initial one.
        size: Width and height in pixels, such as ``1600x1000``.
        timeline: The timeline of the instant.

    Returns:
        A PNG, and the views with their reports.

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
            return _stable_screenshot(client), client.get_state().views
        except (RuntimeError, ValueError, OSError) as error:
            raise ViewerError(f"the viewer failed: {error}") from error


def require_reachable(url: str) -> None:
    """Check that a viewer listens at a URL, since Rerun would wait for it without a time limit.

    Raises:
        ViewerError: It does not, or the URL is invalid.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port or parts.scheme not in ("rerun", "rerun+http", "rerun+https") or parts.path != "/proxy":
        raise ViewerError(f"{url} is not the URL of a viewer, such as rerun+http://127.0.0.1:9876/proxy")
    try:
        socket.create_connection((host, port), _TIMEOUT / 6).close()
    except OSError as error:
        raise ViewerError(f"the viewer at {url} cannot be reached: {(error.strerror or str(error)).lower()}") from None


def _stable_screenshot(client: ViewerClient) -> bytes:
    """Return the screenshot once it is stable: the axes of plots are animated."""
    deadline, still = time.monotonic() + _SETTLING, 1
    shown: bytes = client.take_screenshot()
    while still < _STILL and time.monotonic() < deadline:
        time.sleep(0.15)
        before, shown = shown, client.take_screenshot()
        still = still + 1 if shown == before else 1
    return shown


def _executable() -> Path:
    """Return the path of the viewer itself: the command ``rerun`` is a wrapper, whose child would survive it."""
    import rerun_cli

    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    return Path(rerun_cli.__file__).with_name(name)


def _environment(home: Path, *, verbose: bool) -> dict[str, str]:
    """Create the environment of a viewer, with a separate folder for settings."""
    settings = home / "rerun" / "analytics.json"
    settings.parent.mkdir()
    data = home / "rerun" / "analytics"
    # Statistics are off only if the file has all of these entries.
    content = {"analytics_enabled": False, "analytics_id": "none", "metadata": {}}
    content |= {"config_file_path": str(settings), "data_dir_path": str(data)}
    settings.write_text(json.dumps(content))
    folders = {"XDG_CONFIG_HOME": str(home), "XDG_DATA_HOME": str(home), "XDG_CACHE_HOME": str(home)}
    levels = "error,re_grpc_server=info,re_sdk::web_viewer=info" if verbose else "error"
    return {**os.environ, **folders, "RERUN_APP_ONLY": "true", "RUST_LOG": levels, "NO_COLOR": "1"}


def _await_output(process: subprocess.Popen[bytes], said: Path, announced: re.Pattern[str]) -> str:
    """Wait until the output of the viewer matches a pattern, and return the matched group.

    Raises:
        ViewerError: It ended, or does not start.
    """
    for ended in _poll(process):
        if found := announced.search(said.read_text(errors="replace")):
            return found[1]
        if ended:
            raise ViewerError(_reason(_error_output(said)))
    raise ViewerError(_TIMED_OUT)


def _await_answer(process: subprocess.Popen[bytes], said: Path, url: str) -> None:
    """Wait until the viewer answers, which it does when it draws.

    Raises:
        ViewerError: It ended, or does not start.
    """
    from rerun.experimental import ViewerClient

    for ended in _poll(process):
        if ended:
            raise ViewerError(_reason(_error_output(said)))
        try:
            ViewerClient.connect(url).get_state()
        except (RuntimeError, ValueError, OSError):
            continue
        return
    raise ViewerError(_TIMED_OUT)


def _poll(process: subprocess.Popen[bytes]) -> Iterator[bool]:
    """Yield at intervals whether a process has ended, until the time limit."""
    deadline = time.monotonic() + _TIMEOUT
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
    return f"the viewer ended at once: {said or 'no output'}"


def _error_output(said: Path) -> str:
    """Return the error output of a viewer."""
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
    """Return the URL at which a viewer accepts recordings."""
    return f"rerun+http://{_reachable(bind)}:{port}/proxy"


def _reachable(bind: str) -> str:
    """Return the address at which a server on this machine can be reached."""
    if bind in ("0.0.0.0", "::"):
        return "127.0.0.1"
    return f"[{bind}]" if ":" in bind else bind


def _end_with_parent() -> Callable[[], object] | None:
    """Return a function that makes Linux end a child process when its parent dies, even by kill -9."""
    if sys.platform != "linux":
        return None
    import ctypes

    # Resolved before the fork, after which few calls are safe. 1 is PR_SET_PDEATHSIG.
    prctl, death = ctypes.CDLL(None).prctl, int(signal.SIGTERM)
    return lambda: prctl(1, death)
