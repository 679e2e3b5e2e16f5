"""Sections about repetition: the scenario as written and resolved, and the commands to repeat the run or sweep."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from symaware_cli.evidence.report.report_section import ReportSection, ReportSubject
from symaware_cli.language import ORIGIN
from symaware_cli.studies import SWEEP, WRITTEN
from symaware_cli.views import Block, CodeLines, FactTable, Fold, SourceText

#: The maximum length of the text shown of a file [characters].
_MOST_TEXT = 100_000


class ScenarioFiles(ReportSection):
    """The files of the scenario; of a log also the resolved scenario."""

    title: ClassVar = "The scenario"
    order: ClassVar = 1000

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is anything but a log by another program."""
        return subject.folder is not None or subject.run is not None

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield each file."""
        for name, data in _files(subject).items():
            if name.endswith((".yaml", ".yml", ".toml")):
                text = data.decode(errors="replace")
                cut = "\n..." if len(text) > _MOST_TEXT else ""
                is_open = subject.log is None or name != "resolved.yaml"
                yield Fold(name, [SourceText(text[:_MOST_TEXT] + cut)], is_open)


class Repetition(ReportSection):
    """The commands to install the same versions and to repeat the run or sweep, and all versions."""

    title: ClassVar = "How to repeat it"
    order: ClassVar = 1010

    def applies(self, subject: ReportSubject) -> bool:
        """Return whether the subject is anything but a log by another program."""
        return subject.folder is not None or subject.run is not None

    def content(self, subject: ReportSubject) -> Iterator[Block]:
        """Yield the commands, and the versions."""
        name = subject.path.name
        if subject.folder is not None:
            versions, commands = subject.folder.identity.versions, [f"symaware verify {name} --level all"]
        else:
            assert subject.overview is not None
            versions = subject.overview.versions
            commands = [f"symaware verify {name}", f"symaware run {name}"]
        yield CodeLines("\n".join([*_installation(versions), *commands]))
        yield Fold(f"All {len(versions)} versions", [FactTable(versions)])


def _files(subject: ReportSubject) -> Mapping[str, bytes]:
    """Return the files of the scenario, by name."""
    if subject.folder is not None:
        folder = subject.folder
        files = {each.name: each.read_bytes() for each in (folder.path / WRITTEN, folder.path / SWEEP) if each.exists()}
        return {**files, folder.source.scenario.name: folder.source.scenario.read_bytes()}
    assert subject.log is not None
    assert subject.overview is not None
    return {name: data for name, data in subject.log.attachments.items() if name in subject.overview.scenario}


def _installation(versions: Mapping[str, str]) -> Iterator[str]:
    """Yield the commands to install the package versions used, from the recorded commit or wheel if known."""
    package, origin = versions.get("symaware-cli", "of an unknown version"), versions.get(ORIGIN, "")
    if origin.startswith("git+"):
        yield f"pip install 'symaware-cli[all] @ {origin}'"
    elif origin.startswith("commit "):
        yield f"git checkout {origin.removeprefix('commit ')}   # in a checkout of SymAware"
        yield "pip install '.[all]'"
    elif origin:
        file, _, digest = origin.partition(", ")
        yield f"pip install './{file}[all]'{f'   # {digest}' if digest else ''}"
    else:
        yield f"# made with SymAware {package}, as it was installed there; its commit or wheel was not recorded"
