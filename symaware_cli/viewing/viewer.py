"""The Rerun viewer as a process: on the screen, in a browser, or without either for pictures."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from symaware_cli.recording.error import LogError

if TYPE_CHECKING:
    from rerun.experimental import View, ViewerClient

#: How long a viewer may take to listen [s].
_PATIENCE = 30.0
#: How long a picture may take to come to rest [s].
_SETTLING = 5.0
#: Where Rerun serves its viewer for browsers, unless told otherwise.
WEB_PORT = 9090


class ViewerError(Exception):
    """The viewer did not do what it was asked to."""


@dataclass(frozen=True)
class Viewer:
    """A viewer that runs.

    Attributes:
        process: Its process, a child of this one.
        url: Where recordings are sent to.
    """

    process: subprocess.Popen[bytes]
    url: str

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
    os.environ.setdefault("RERUN_ANALYTICS", "off")
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

    Args:
        headless: Without a window, for pictures.
        web: For browsers.
        bind: The address it listens on.
        web_port: Where it serves browsers; 0 for any free port.
        size: Of the window, such as ``1600x1000``.

    Raises:
        ViewerError: It does not come up, and what it said.
    """
    port = _free_port(bind)
    command = [str(_executable()), "--bind", bind, "--port", str(port), "--hide-welcome-screen"]
    if headless:
        command.append("--headless")
    if web:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
    if size:
        command += ["--window-size", size]
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "RERUN_APP_ONLY": "true", "RUST_LOG": "error"},
        # Ctrl-C reaches this process alone, which then ends the viewer.
        start_new_session=True,
        preexec_fn=_die_with_parent if sys.platform == "linux" else None,
    )
    try:
        _await_port(process, bind, port)
        if web:
            _await_port(process, bind, web_port)
        yield Viewer(process, f"rerun+http://{_reachable(bind)}:{port}/proxy")
    finally:
        _end(process)


def web_link(bind: str, viewer_url: str, web_port: int = WEB_PORT) -> str:
    """The link that a browser opens."""
    from urllib.parse import quote

    return f"http://{_reachable(bind)}:{web_port}?url={quote(viewer_url, safe='')}"


def picture(recording: Path, moment: int | None, size: str = "1600x1000") -> tuple[bytes, list[View]]:
    """Take a picture of a recording without a screen.

    Args:
        recording: An .rrd file, with its blueprint.
        moment: Simulated time [ns]; None for wherever the viewer begins.
        size: Width and height in pixels, such as ``1600x1000``.

    Returns:
        A PNG, and the views with what they report.

    Raises:
        ViewerError: There is no graphics driver, or the viewer failed.
    """
    from rerun.experimental import ViewerClient

    from symaware_cli.viewing.stage import TIMELINE

    with viewer(headless=True, size=size) as running:
        try:
            client = ViewerClient.connect(running.url)
            client.open([str(recording)])
            deadline = time.monotonic() + _PATIENCE
            while (state := client.get_state()).loading and time.monotonic() < deadline:
                time.sleep(0.05)
            if moment is not None:
                client.set_time(TIMELINE, duration=moment / 1e9, play_state="paused")
            shown = _settled(client)
            state = client.get_state()
        except Exception as error:
            said = _said(running.process)
            raise ViewerError(f"the viewer failed: {said or error}") from error
    return shown, state.views


def _settled(client: ViewerClient) -> bytes:
    """The picture once nothing moves any more: axes of plots glide to where they belong."""
    deadline = time.monotonic() + _SETTLING
    shown: bytes = client.take_screenshot()
    while time.monotonic() < deadline:
        time.sleep(0.25)
        before, shown = shown, client.take_screenshot()
        if shown == before:
            break
    return shown


def _executable() -> Path:
    """The viewer itself: the command ``rerun`` is a wrapper, whose child would survive it."""
    import rerun_cli  # type: ignore[import-untyped]

    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    return Path(rerun_cli.__file__).with_name(name)


def _await_port(process: subprocess.Popen[bytes], bind: str, port: int) -> None:
    """Wait until the viewer listens.

    Raises:
        ViewerError: It ended, or does not come up.
    """
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise ViewerError(_reason(_said(process)))
        try:
            socket.create_connection((_reachable(bind), port), 0.5).close()
        except OSError:
            time.sleep(0.05)
        else:
            return
    raise ViewerError(f"the viewer did not come up within {_PATIENCE:g} s")


def _reason(said: str) -> str:
    if "graphics adapter" in said or "winit" in said or "DISPLAY" in said:
        return (
            "the viewer found no screen or graphics driver; --web shows the replay in a browser, --save keeps it for "
            "another machine, and Debian's mesa-vulkan-drivers is enough for --screenshot"
        )
    return f"the viewer ended at once: {said or 'it said nothing'}"


def _said(process: subprocess.Popen[bytes]) -> str:
    """What a viewer printed, after it has ended."""
    _end(process)
    assert process.stdout
    return process.stdout.read().decode(errors="replace").strip()[-2000:]


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
    family = socket.AF_INET6 if ":" in bind else socket.AF_INET
    with socket.socket(family) as probe:
        try:
            probe.bind((bind, 0))
        except OSError as error:
            raise ViewerError(f"cannot listen on {bind}: {error.strerror or error}") from None
        port: int = probe.getsockname()[1]
        return port


def _reachable(bind: str) -> str:
    """Where to reach something on this machine that listens on an address."""
    return {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(bind, f"[{bind}]" if ":" in bind else bind)


def _die_with_parent() -> None:
    """Ask Linux to end this process when its parent dies, even of kill -9."""
    import ctypes

    ctypes.CDLL(None).prctl(1, signal.SIGTERM)
