"""The Rerun viewer with a recording, as a part of a page of HTML that needs no network."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from urllib.request import ProxyHandler, build_opener

from symaware_cli.log import LogError
from symaware_cli.views.viewer import ViewerError, require, viewer

#: Time limit for reading a file of the viewer [s].
_TIMEOUT = 60.0


@dataclass(frozen=True, slots=True)
class EmbeddedViewer:
    """The viewer and a recording, for ``embedded_viewer.js``.

    The security policy of the page has to allow ``'wasm-unsafe-eval'`` for scripts, besides those within the page.

    Attributes:
        version: The version of Rerun.
        files: The module of the viewer and the recording by name, compressed (gzip), in base64.
        script: The script of the viewer, as the content of a script element.
    """

    version: str
    files: Mapping[str, str]
    script: str


def embedded_viewer(recording: Path) -> EmbeddedViewer:
    """Return the viewer with a recording.

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
    data = {"module": module, "recording": recording.read_bytes()}
    packed = {name: base64.b64encode(gzip.compress(each, mtime=0)).decode() for name, each in data.items()}
    # What would end the script element is escaped.
    return EmbeddedViewer(metadata.version("rerun-sdk"), packed, script.replace("</script", "<\\/script"))


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
