"""The Rerun viewer with a recording, as a part of a page of HTML that needs no network."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Iterator
from importlib import metadata
from importlib.resources import files
from pathlib import Path
from urllib.request import ProxyHandler, build_opener

from symaware_cli.recording.error import LogError
from symaware_cli.viewing.viewer import ViewerError, require, viewer

#: Time limit for reading a file of the viewer [s].
_TIMEOUT = 60.0

POLICY = "'wasm-unsafe-eval'"
"""What the security policy of a page has to allow for scripts, besides those within the page."""

_FRAME = """\
<div class="replay"><p><button type="button">Start the viewer</button> <output></output></p>
<canvas id="rerun-viewer" hidden tabindex="0" aria-label="Rerun viewer"></canvas></div>
<p class="note">Rerun %s (MIT or Apache-2.0) with the recording, inside this page.</p>"""


def embedded_viewer(recording: Path) -> Iterator[str]:
    """Yield the parts of the page: a button, which starts the viewer, and all that it needs.

    It starts by itself where the address of the page ends in ``#viewer``.

    Args:
        recording: An .rrd file, with its blueprint.

    Raises:
        LogError: Rerun is not installed, or its viewer does not start.
    """
    require()
    try:
        script, module = _viewer_files()
    except (ViewerError, OSError) as error:
        raise LogError(f"the viewer cannot be put into the page: {error}") from error
    yield _FRAME % metadata.version("rerun-sdk")
    for name, data in (("module", module), ("recording", recording.read_bytes())):
        packed = base64.b64encode(gzip.compress(data, mtime=0)).decode()
        yield f'<script type="application/octet-stream" id="rerun-{name}">{packed}</script>'
    start = files("symaware_cli.viewing").joinpath("embedded_viewer.js").read_text(encoding="utf-8")
    yield f"<script>{_within_a_script(script)}</script><script>{start}</script>"


def _viewer_files() -> tuple[str, bytes]:
    """Return the script and the WebAssembly module of the viewer for browsers, which the installed one serves."""
    opener = build_opener(ProxyHandler({}))
    with viewer(web=True, web_port=0) as running:
        address = running.link.partition("?")[0]
        found = []
        for name in ("re_viewer.js", "re_viewer_bg.wasm"):
            with opener.open(address + name, timeout=_TIMEOUT) as answer:
                found.append(answer.read())
    return found[0].decode(), found[1]


def _within_a_script(text: str) -> str:
    """Escape what would end the script."""
    return text.replace("</script", "<\\/script")
