"""A browser without a window, driven over pipes by the Chrome DevTools Protocol (Target and Page domains)."""

import base64
import fcntl
import json
import os
import subprocess
from pathlib import Path
from typing import Any

_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage"),
    # Whatever a page asks for beyond this machine is not there.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--remote-debugging-pipe",
)


class Browser:
    """Chromium, which shows one page; use it in a `with` block."""

    def __init__(self, executable: str, profile: Path, size: tuple[int, int] = (1000, 700)) -> None:
        commands, self._commands = os.pipe()
        self._answers, answers = os.pipe()
        # The protocol's pipes are 3 and 4, which must not be in the way themselves.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 50) for end in (commands, answers)]
        flags = [*_FLAGS, f"--user-data-dir={profile}", "--window-size={},{}".format(*size)]
        self._process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{ends[0]} 4>&{ends[1]}', "bash", executable, *flags, "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=ends,
        )
        for end in (*ends, commands, answers):
            os.close(end)
        self._read = b""
        self._number = 0
        self._session: str | None = None

    def open(self, url: str) -> None:
        """Open a page."""
        target = self._call("Target.createTarget", url=url)["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def screenshot(self) -> bytes:
        """Take a picture of the page, as PNG."""
        return base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"])

    def _call(self, method: str, **parameters: Any) -> Any:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._read:
                more = os.read(self._answers, 1 << 16)
                assert more, "the browser ended"
                self._read += more
            answer, _, self._read = self._read.partition(b"\0")
            content = json.loads(answer)
            if content.get("id") == self._number:
                assert "result" in content, content
                return content["result"]

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._commands)
        os.close(self._answers)
