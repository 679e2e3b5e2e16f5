"""A run or a sweep as one page of HTML, with all that a reader needs to judge and to repeat it, and no network."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from symaware_cli.api.certification import CERTIFICATE
from symaware_cli.api.page_printer import print_page, require_printing
from symaware_cli.api.sweeps import FilePath, read_shares, scenario_of
from symaware_cli.recording.digest import digest
from symaware_cli.recording.error import LogError
from symaware_cli.recording.output import whole_file
from symaware_cli.recording.overview import overview
from symaware_cli.recording.reader import Log, open_log
from symaware_cli.study.certificate_page import STYLE, section
from symaware_cli.study.folder import SweepFolder
from symaware_cli.study.identity import SweepIdentity
from symaware_cli.study.row import Row
from symaware_cli.study.signed_statement import read_statement
from symaware_cli.study.sweep_files import JOURNAL, SWEEP, WRITTEN
from symaware_cli.study.sweep_journal import SweepJournal
from symaware_cli.viewing.embedded_viewer import POLICY, embedded_viewer
from symaware_cli.viewing.plotting.plot import matplotlib_required, plot
from symaware_cli.viewing.replay_session import replay_session
from symaware_cli.viewing.viewer import require

_STYLE = """\
svg{max-width:100%;height:auto}canvas{border:1px solid #dde2ea;border-radius:4px}
.controls{display:flex;gap:.8rem;align-items:center;margin:.4rem 0;font-size:.9em}.controls input[type=range]{flex:1}
.jumps button{font-size:.8em;margin:0 .3rem .3rem 0}output{min-width:5em;font-variant-numeric:tabular-nums}
pre{background:#f5f7fa;padding:.8rem 1rem;border-radius:4px;white-space:pre-wrap}details{margin:.5rem 0}
summary{cursor:pointer;color:#566072}.k{color:#175a99}.c{color:#78828f}.s{color:#136f3a}
.satisfied{color:#136f3a}.violated,.failed{color:#a3261d}.undecided,.rejected{color:#8a5a00}
#certificate{margin-top:1.8rem}#certificate h1{font-size:1.15rem}
.replay canvas{width:100%;height:36rem}
svg,tr{break-inside:avoid}h2{break-after:avoid}
@media print{.screen{display:none}.note,th,summary{color:#333}summary{list-style:none}
.versions{columns:2;font-size:.75em}.versions td{overflow-wrap:anywhere}}
"""
#: Nothing is fetched, whatever the content of a log says.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"

#: What is folded on the screen is printed in full.
_UNFOLDED = (
    '<script>addEventListener("beforeprint",()=>document.querySelectorAll("details").forEach(e=>e.open=true))</script>'
)

#: The most text of a scenario that is shown [characters].
_MOST_TEXT = 100_000


def write_report(path: FilePath, output: FilePath, viewer: bool = False, pdf: FilePath | None = None) -> Path:
    """Write the report of a log or of the folder of a sweep.

    That of a sweep shows the run with the least robustness, which is made again for it.

    Args:
        path: The log or the folder.
        output: The page; one that is there is replaced.
        viewer: Whether the page has the Rerun viewer with a replay of the run in it, which takes about 19 MB.
        pdf: A file for the page as a browser prints it; None for none.

    Returns:
        The page.

    Raises:
        LogError: There is no log and no sweep, a package is missing, or there is no browser for a PDF.
        OutputError: The page cannot be written.
    """
    path, output = Path(path), Path(output)
    if pdf is not None:
        require_printing(Path(pdf))
    title, parts = _of_sweep(path, viewer=viewer) if path.is_dir() else _of_log(path, viewer=viewer)
    policy = _POLICY.replace("script-src", f"script-src {POLICY}") if viewer else _POLICY
    page = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}"><title>{escape(title)}</title>'
        f"<style>{STYLE}{_STYLE}</style></head><body><h1>{escape(title)}</h1>{''.join(parts)}{_UNFOLDED}</body></html>\n"
    )
    with whole_file(output, *([] if path.is_dir() else [path])) as partial:
        partial.write_text(page, encoding="utf-8", errors="replace")
    if pdf is not None:
        print_page(output, Path(pdf))
    return output


def _of_log(path: Path, *, viewer: bool) -> tuple[str, list[str]]:
    log = open_log(path)
    found = overview(log)
    agents = ", ".join(f"{count} {name}" for name, count in found.agents.items())
    facts = {
        "outcome": found.status + (f"; {found.damage}" if found.damage else ""),
        "scenario": f"{found.name}, seed {found.seed}, {found.mode}",
        "agents": agents,
        "other bodies": ", ".join(found.entities),
        "simulated time": f"{found.simulated_time or 0:g} s, {found.steps} steps of {found.time_step} s",
        "digest": digest(log).combined,
    }
    parts = [_table(facts), *_of_specifications(log), *_of_motion(log, viewer=viewer)]
    if found.events:
        parts += [_heading("Events"), _table({name: f"{count:,}" for name, count in found.events.items()})]
    texts = {name: data for name, data in log.attachments.items() if name in found.scenario}
    parts += _of_scenario(texts, "resolved.yaml")
    parts += _of_repetition([f"symaware verify {path.name}", f"symaware run {path.name}"], found.versions)
    return f"{found.name or path.name}: {found.status}", parts


def _of_sweep(path: Path, *, viewer: bool) -> tuple[str, list[str]]:
    folder = SweepFolder.opened(path)
    document = folder.plan.document
    with SweepJournal(folder.path / JOURNAL) as journal:
        counts, worst = journal.counts(), _worst(journal)
    states = ", ".join(f"{count:,} {name}" for name, count in counts._asdict().items() if count)
    facts = {
        "scenario": f"{folder.source.scenario.name}, seed of the sweep {document.seed}",
        "asked": document.description,
        "runs": f"{counts.all:,} of {folder.plan.count:,}: {states}",
        "combinations": f"{len(folder.plan.cells):,}",
        "claim": document.claim or "none",
    }
    parts = [_table(facts), *_of_shares(path), *_of_certificate(path), *_of_metrics(path)]
    if worst is not None:
        said = ", ".join(f"{name} {verdict}" for name, verdict in worst.verdicts.items())
        parts.append(_heading(f"Run {worst.index}, the least robust"))
        parts.append(f"<p>{escape(said)}. <code>symaware run {escape(path.name)} --index {worst.index}</code></p>")
        with tempfile.TemporaryDirectory() as temporary:
            log = open_log(_repeated(path, worst.index, Path(temporary)))
            parts += [*_of_specifications(log), *_of_motion(log, viewer=viewer)]
    files = {each.name: each.read_bytes() for each in (folder.path / WRITTEN, folder.path / SWEEP) if each.exists()}
    files[folder.source.scenario.name] = folder.source.scenario.read_bytes()
    parts += _of_scenario(files, "")
    identity: SweepIdentity = folder.identity
    parts += _of_repetition([f"symaware verify {path.name} --level all"], identity.versions)
    return f"Sweep {path.resolve().name}", parts


def _worst(journal: SweepJournal) -> Row | None:
    """The run with the least robustness; the first that is done where none has any."""
    done = list(journal.rows("done"))
    return min(done, key=lambda row: (min(_known(row), default=float("inf")), row.index), default=None)


def _known(row: Row) -> list[float]:
    return [value for value in row.robustness.values() if value is not None]


def _repeated(path: Path, index: int, folder: Path) -> Path:
    scenario_of(path, index).run(output=folder / "run.mcap")
    return folder / "run.mcap"


def _of_specifications(log: Log) -> Iterator[str]:
    if not log.outcomes:
        return
    yield _heading("Specifications")
    yield "<table><tr><th>name</th><th>formula</th><th>verdict</th><th>robustness</th><th>reason</th></tr>"
    for each in log.outcomes:
        robustness = "" if each.robustness is None else f"{'' if each.is_exact else 'at most '}{each.robustness:.6g}"
        who = f" ({' and '.join(each.agents)})" if each.agents else ""
        cells = [escape(each.name), f"<code>{escape(each.formula)}</code>"]
        cells += [f'<b class="{escape(each.verdict)}">{escape(each.verdict)}</b>', robustness]
        cells.append(_prose(each.reason + who))
        yield f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"
    yield "</table>"


def _of_motion(log: Log, *, viewer: bool) -> Iterator[str]:
    with matplotlib_required():
        from symaware_cli.viewing.moving_map import moving_map
    if viewer:
        yield from _on_screen("Replay", *_of_replay(log))
    try:
        yield from _on_screen("The run", moving_map(log))
        with tempfile.TemporaryDirectory() as temporary:
            picture = Path(temporary, "plot.svg")
            plot(log, picture)
            yield _heading("Figures") + _inline(picture)
    except LogError as error:
        yield f'<p class="note">{_prose(str(error))}</p>'


def _of_replay(log: Log) -> Iterator[str]:
    require()
    with tempfile.TemporaryDirectory() as temporary:
        recording = Path(temporary, "run.rrd")
        replay_session(log).save(recording)
        yield from embedded_viewer(recording)


def _on_screen(title: str, *content: str) -> Iterator[str]:
    """Yield a part of the page that is of no use on paper."""
    yield from ('<div class="screen">', _heading(title), *content, "</div>")


def _of_metrics(path: Path) -> Iterator[str]:
    from symaware_cli.study.picture.sweep_picture import plot_sweep

    with tempfile.TemporaryDirectory() as temporary:
        picture = Path(temporary, "plot.svg")
        try:
            plot_sweep(path, picture)
        except LogError as error:
            yield f'<p class="note">{_prose(str(error))}</p>'
        else:
            yield _heading("Figures") + _inline(picture)


def _of_shares(path: Path) -> Iterator[str]:
    found = read_shares(path)
    if not found:
        return
    yield _heading("Statistics")
    yield "<table><tr><th>combination</th><th>specification</th><th>satisfied</th><th>share</th><th>interval</th></tr>"
    for each in found[:200]:
        names = [*filter(None, [each.cell.variant]), *(f"{path} = {v}" for path, v in each.cell.parameters.items())]
        interval = each.interval
        cells = [", ".join(names) or "as it is", each.specification, f"{each.satisfied:,} of {interval.count:,}"]
        cells.append(f"{interval.value:.4g}")
        known = f"{interval.lower:.4g} to {interval.upper:.4g} ({interval.method}, {interval.confidence:g})"
        cells.append(known if interval.method else "none: the runs depend on each other")
        yield f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
    yield "</table>"


def _of_certificate(path: Path) -> Iterator[str]:
    file = path / CERTIFICATE
    if not file.is_file():
        return
    try:
        read = read_statement(file.read_bytes())
        content = "".join(section(read.content, read.public_key))
    except (ValueError, KeyError, TypeError) as error:
        yield f'{_heading("Certificate")}<p class="no">{escape(f"{CERTIFICATE} cannot be read: {error}")}</p>'
        return
    yield f'<div id="certificate">{content}</div>'
    yield '<p class="note">As it stands in the folder; this page does not verify it.</p>'


def _of_scenario(texts: Mapping[str, bytes], folded: str) -> Iterator[str]:
    yield _heading("The scenario")
    for name, data in texts.items():
        if not name.endswith((".yaml", ".yml", ".toml")):
            continue
        text = data.decode(errors="replace")
        cut = "\n..." if len(text) > _MOST_TEXT else ""
        is_open = "" if name == folded else " open"
        shown = _highlighted(text[:_MOST_TEXT] + cut)
        yield f"<details{is_open}><summary>{escape(name)}</summary><pre>{shown}</pre></details>"


def _of_repetition(commands: Sequence[str], versions: Mapping[str, str]) -> Iterator[str]:
    yield _heading("How to repeat it")
    package = versions.get("symaware-cli", "")
    shown = [f"pip install 'symaware-cli[all]{f'=={package}' if package else ''}'", *commands]
    yield f"<pre>{escape(chr(10).join(shown))}</pre>"
    listed = f'<div class="versions">{_table(versions)}</div>'
    yield f"<details><summary>All {len(versions)} versions</summary>{listed}</details>"


def _highlighted(text: str) -> str:
    """Colour comments, keys and quoted texts of YAML and TOML."""
    pattern = re.compile(
        r"""(?P<c>(?:(?<=\s)|^)\#[^\n]*)|(?P<s>"(?:[^"\\\n]|\\.)*"|'[^'\n]*')|(?P<k>[\w./-]+(?=\s*[:=](?:\s|$)))""",
        re.M,
    )

    def coloured(found: re.Match[str]) -> str:
        return f"\0{found.lastgroup}\1{found[0]}\2"

    marked = escape(pattern.sub(coloured, re.sub("[\0\1\2]", "", text)), quote=False)
    return re.sub("\0(.)\1", r'<span class="\1">', marked).replace("\2", "</span>")


def _inline(picture: Path) -> str:
    text = picture.read_text(encoding="utf-8")
    return text[text.index("<svg") :]


def _prose(text: str) -> str:
    """Return a sentence as HTML; what stands between backticks is code."""
    return re.sub("`([^`]*)`", r"<code>\1</code>", escape(text))


def _heading(text: str) -> str:
    return f"<h2>{escape(text)}</h2>"


def _table(facts: Mapping[str, Any]) -> str:
    rows = (f"<tr><th>{escape(name)}</th><td>{escape(str(text))}</td></tr>" for name, text in facts.items() if text)
    return f"<table>{''.join(rows)}</table>"
