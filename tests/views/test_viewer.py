"""The viewer as a process: it comes up, answers, keeps to itself, and goes."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from rerun_files import needs_graphics
from simulating import present

from symaware_cli.views.viewer import ViewerError, require_reachable, viewer


def listening(pid: int) -> set[str]:
    """The addresses that a process listens on."""
    sockets = {os.readlink(each) for each in Path(f"/proc/{pid}/fd").iterdir() if each.is_symlink()}
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and f"socket:[{fields[9]}]" in sockets:
                found.add(fields[1].rpartition(":")[0])
    return found


linux_only = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


@linux_only
def test_for_browsers_it_listens_on_this_machine_alone_and_serves_the_link() -> None:
    with viewer(web=True, web_port=0) as running:
        assert listening(running.process.pid) == {"0100007F"}
        page = running.link.partition("?")[0]
        assert b"Rerun" in urllib.request.urlopen(page, timeout=10).read()
        require_reachable(running.url)
    assert running.process.poll() is not None


@linux_only
def test_it_listens_to_all_if_that_is_asked_for() -> None:
    with viewer(web=True, web_port=0, bind="0.0.0.0") as running:
        assert listening(running.process.pid) == {"00000000"}
        assert running.link.startswith("http://127.0.0.1:")


def test_a_taken_port_is_reported_and_no_other_viewer_receives_data() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        other.settimeout(0.1)
        with pytest.raises(ViewerError, match="port is taken"), viewer(web=True, web_port=other.getsockname()[1]):
            pass
        with pytest.raises(TimeoutError):
            other.accept()


def test_an_address_of_another_machine_is_reported() -> None:
    # Of TEST-NET-1, RFC 5737: nobody's.
    with pytest.raises(ViewerError, match="does not have the address"), viewer(web=True, web_port=0, bind="192.0.2.1"):
        pass


def test_without_a_screen_the_error_names_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ViewerError, match="no screen or graphics driver; --web shows"), viewer():
        pass


@needs_graphics
def test_it_neither_reads_nor_writes_in_the_user_s_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home, temporary = tmp_path / "home", tmp_path / "tmp"
    home.mkdir()
    temporary.mkdir()
    monkeypatch.setenv("HOME", str(home))
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    with viewer(headless=True) as running:
        (folder,) = temporary.iterdir()
        settings = (folder / "rerun" / "analytics.json").read_text()
        # Rerun writes the file anew, with statistics on, if it does not like it.
        assert '"analytics_enabled": false' in settings
        assert not (folder / "rerun" / "analytics").exists()
        require_reachable(running.url)
    assert list(home.rglob("*")) == []
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("url", ["", "nonsense", "http://127.0.0.1:9/proxy", "rerun+http://127.0.0.1:99999/proxy"])
def test_a_url_without_a_viewer_is_reported(url: str) -> None:
    with pytest.raises(ViewerError, match="is not the URL of a viewer"):
        require_reachable(url)


def test_where_nobody_listens_nothing_is_waited_for() -> None:
    with pytest.raises(ViewerError, match="cannot be reached: connection refused"):
        require_reachable("rerun+http://127.0.0.1:1/proxy")


@linux_only
def test_kill_9_leaves_no_viewer_behind() -> None:
    code = """
import sys, time
from symaware_cli.views.viewer import viewer
with viewer(web=True, web_port=0) as running:
    print(running.process.pid, flush=True)
    time.sleep(60)
"""
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    child = int(present(parent.stdout).readline())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    present(parent.stdout).close()
    deadline = time.monotonic() + 20
    while Path(f"/proc/{child}/cmdline").exists() and Path(f"/proc/{child}/cmdline").read_bytes():
        assert time.monotonic() < deadline, "the viewer lives on"
        time.sleep(0.05)
