"""A report is one self-contained page that agrees with the log and shows the run in a browser."""

import base64
import gzip
import json
import re
import shutil
import subprocess
import sys
import time
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
import yaml
from browser import Browser
from matplotlib.image import imread
from rerun_files import Recording, needs_browser, pixels
from typer.testing import CliRunner

import symaware_cli as sa
from symaware_cli.cli.application import application
from symaware_cli.evidence import write_report
from symaware_cli.evidence.report.report_section import ReportSubject
from symaware_cli.evidence.report.sections.run_sections import ReplayFrameSection
from symaware_cli.log import OutputError
from symaware_cli.views import ReplayFrame, embedded_viewer
from symaware_cli.views.palette import BACKGROUND

#: Two robots that pass each other.
SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "tiny",
    "run": {"duration": 0.5},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "robot": {
            "count": 2,
            "entity": {"shape": {"circle": {"radius": 0.2}}},
            "model": {"use": "single-integrator", "with": {"process_noise": 0.3}},
            "state": [[0, 0], [1, 0]],
            "knowledge": {"goal": [[1, 0], [0, 0]]},
            "components": {"see": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
        }
    },
    "specifications": {"apart": {"pairs": "robot", "formula": "always distance > 0.5"}},
}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A run of two robots that come too close to each other."""
    (tmp_path / "tiny.yaml").write_text(f"# <script>alert(1)</script>\n{yaml.safe_dump(SCENARIO)}")
    path = tmp_path / "tiny.mcap"
    sa.load(tmp_path / "tiny.yaml", {"run.duration": 2.0}).run(output=path)
    return path


def data(page: str) -> dict[str, Any]:
    """Return the data from which the map is drawn."""
    found = re.search(r'movingMap\(document.querySelector\(".map"\),(\{.*\})\);</script>', page)
    assert found
    content: dict[str, Any] = json.loads(found[1])
    return content


def test_without_matplotlib_the_error_names_the_command_to_install_it(log: Path) -> None:
    code = "import sys; sys.modules['matplotlib'] = None; from symaware_cli.cli import main; main()"
    line = [sys.executable, "-c", code, "report", str(log)]
    done = subprocess.run(line, cwd=log.parent, capture_output=True, text=True, timeout=60, check=False)
    told = "symaware: plots need the module `matplotlib`, which is not installed: pip install 'symaware-cli[plot]'\n"
    assert (done.returncode, done.stderr) == (2, told)
    assert not list(log.parent.glob("*.html"))


def test_a_report_is_one_self_contained_page(log: Path) -> None:
    page = sa.write_report(log, log.with_suffix(".html")).read_text()
    assert "default-src 'none'" in page
    addresses = re.findall(r"""(?:src|href)=["']([^#"']+)""", page)
    assert [each.partition(",")[0] for each in addresses] == ["data:image/svg+xml;base64"]
    assert "<script>alert" not in page
    assert len(page) < 1_000_000


def test_a_report_agrees_with_the_log(log: Path) -> None:
    page = sa.write_report(log, log.with_suffix(".html")).read_text()
    (outcome,) = sa.open_log(log).outcomes
    assert outcome.verdict == "violated"
    formula, reason = outcome.reason.removeprefix("`").split("`")
    assert f"<code>{escape(formula)}</code>{reason}" in page
    for text in ("apart", 'class="violated"', "symaware verify"):
        assert text in page


def test_the_map_shows_the_recorded_positions(log: Path) -> None:
    content = data(sa.write_report(log, log.with_suffix(".html")).read_text())
    recorded = sa.open_log(log).series("robot.1", "world")
    assert len(content["times"]) == len(recorded.times)
    assert content["agents"][1]["x"] == pytest.approx(recorded.column("x"), abs=1e-3)
    assert len(content["marks"]) >= 1


def test_the_map_centres_the_name_of_a_region(tmp_path: Path) -> None:
    shelf = {"shelf": {"circle": {"centre": [4.0, -3.0], "radius": 1.0}}}
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(SCENARIO | {"regions": shelf}))
    log = sa.load(tmp_path / "tiny.yaml").run(output=tmp_path / "run.mcap").log_path
    assert log is not None
    solids = data(sa.write_report(log, tmp_path / "run.html").read_text())["solids"]
    (region,) = [each for each in solids if each["name"] == "shelf"]
    assert (region["x"], region["y"]) == ([4.0], [-3.0])
    (outline,) = region["outlines"]
    assert max(x for x, _ in outline) == pytest.approx(1.0, abs=0.01)
    assert min(y for _, y in outline) == pytest.approx(-1.0, abs=0.01)


def test_the_report_of_a_sweep_has_statistics_certificate_and_worst_run(tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(SCENARIO))
    changes = {"specifications.apart.formula": "always distance > 0"}
    sa.sweep(tmp_path / "tiny.yaml", tmp_path / "out", runs=20, changes=changes, claim="P(apart) > 0.5, sequential")
    assert sa.certify(tmp_path / "out").is_established
    result = CliRunner().invoke(application, ["report", str(tmp_path / "out"), "-o", str(tmp_path / "out.html")])
    assert result.exit_code == 0, result.output
    page = (tmp_path / "out.html").read_text()
    for text in ("Statistics", "Certificate", "the least robust", "beta mixture", "movingMap"):
        assert text in page


def test_invalid_subjects_of_reports_are_rejected(tmp_path: Path) -> None:
    (tmp_path / "broken.mcap").write_bytes(b"x")
    (tmp_path / "empty").mkdir()
    for name in ("broken.mcap", "none.mcap", "empty"):
        result = CliRunner().invoke(application, ["report", str(tmp_path / name), "-o", str(tmp_path / "x.html")])
        assert result.exit_code == 2, result.output
        assert not (tmp_path / "x.html").exists()


@needs_browser
def test_a_browser_without_a_network_draws_the_map(log: Path, tmp_path: Path) -> None:
    page = sa.write_report(log, log.with_suffix(".html"))
    executable = shutil.which("chromium")
    assert executable
    colours = set()
    with Browser(executable, tmp_path / "profile", (900, 1400)) as browser:
        browser.open(page.as_uri())
        (agent, _) = data(page.read_text())["agents"]
        for _ in range(50):
            picture = imread(BytesIO(browser.screenshot()), format="png")
            colours = {"#" + "".join(f"{round(255 * c):02x}" for c in pixel[:3]) for row in picture for pixel in row}
            if agent["colour"] in colours:
                break
    assert agent["colour"] in colours


@needs_browser
def test_a_printed_report_includes_content_that_is_folded_on_screen(log: Path, tmp_path: Path) -> None:
    arguments = ["report", str(log), "-o", str(tmp_path / "tiny.html"), "--pdf", str(tmp_path / "tiny.pdf"), "--json"]
    result = CliRunner().invoke(application, arguments)
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert said["pdf_size"] == (tmp_path / "tiny.pdf").stat().st_size > 10_000
    assert "beforeprint" in (tmp_path / "tiny.html").read_text()


def test_the_viewer_is_in_the_report_with_a_recording_if_it_is_asked_for(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What the installed viewer serves takes seconds to compress.
    monkeypatch.setattr(embedded_viewer, "_viewer_files", lambda: ("let text = '</script>';", b"module"))
    section, run = ReplayFrameSection(), sa.open_log(log)
    assert not section.applies(ReportSubject(log, log=run, run=run))
    subject = ReportSubject(log, log=run, run=run, has_viewer=True)
    assert section.applies(subject)
    (frame,) = section.content(subject)
    assert isinstance(frame, ReplayFrame)
    assert frame.viewer.script == "let text = '<\\/script>';"
    files = {name: gzip.decompress(base64.b64decode(text)) for name, text in frame.viewer.files.items()}
    assert files["module"] == b"module"
    recording = log.with_suffix(".rrd")
    recording.write_bytes(files["recording"])
    assert "/world/agents/robot/body" in Recording(recording).entities


@pytest.mark.slow
@needs_browser
def test_a_browser_without_a_network_shows_the_replay_within_the_page(log: Path, tmp_path: Path) -> None:
    page = sa.write_report(log, log.with_suffix(".html"), viewer=True)
    assert page.stat().st_size < 25_000_000
    text = page.read_text()
    assert "default-src 'none'" in text
    addresses = re.findall(r"""<[a-z]+ [^>]*(?:src|href)=["']([^#"']+)""", text)
    assert {each.partition(",")[0] for each in addresses} == {"data:image/svg+xml;base64"}
    executable = shutil.which("chromium")
    assert executable
    shown: set[tuple[int, int, int]] = set()
    deadline = time.monotonic() + 120
    with Browser(executable, tmp_path / "profile", (900, 1400)) as browser:
        browser.open(f"{page.as_uri()}#viewer")
        while BACKGROUND not in shown and time.monotonic() < deadline:
            time.sleep(1)
            shown = {tuple(pixel) for pixel in pixels(browser.screenshot())[::2, ::2].reshape(-1, 3).tolist()}
    assert BACKGROUND in shown


@pytest.mark.parametrize(
    ("output", "pdf"),
    [("missing/page.html", None), pytest.param("page.html", "missing/page.pdf", marks=needs_browser)],
)
def test_a_page_that_cannot_be_written_is_found_before_the_log_is_read(
    output: str, pdf: str | None, tmp_path: Path
) -> None:
    (tmp_path / "notes.mcap").write_text("no log")
    wrong = tmp_path / (pdf or output)
    with pytest.raises(OutputError, match=f"cannot write {wrong}: its folder does not exist"):
        write_report(tmp_path / "notes.mcap", tmp_path / output, pdf=None if pdf is None else wrong)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.mcap"]
