"""The examples in documents are true: commands print the shown output, and snippets work."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from simulating import invoked

from symaware_cli.cli import terminal
from symaware_cli.language.build import build

TOP = Path(__file__).parents[1]
DOCUMENTS = sorted([*TOP.glob("*.md"), *TOP.glob("docs/**/*.md"), *TOP.glob("plugins/*/*.md")])

#: What differs from run to run and from machine to machine.
VOLATILE = (
    r"[\d.,]+ (kB|MB|B)\b",
    r"wall time .*",
    r"[\d.]+ s of wall time",
    r"\b\d+\.\d+\.\d+\b(\.dev\d+)?(\+\w+(\.\w+)*)?",  # a version
    r"and \d+ more \(--json\)",
    r"/timing .*",
    r"SHA-256 \S+",
    r"the centres of .* at",  # several pairs are equally near in head-on.yaml; rounding chooses
)

#: Documents whose commands get a process each, as a user's do: with plugins in a file, and in an installed package.
PROCESSES = ("docs/communication.md", "docs/tutorials/own-controller.md")

#: What a snippet that is no scenario by itself is added to.
BASE = """\
symaware: 1
name: base
run: {duration: 1.0}
environment: {use: kinematic}
agents: {robot: {count: 4, model: {use: unicycle}}}
"""


class Block(NamedTuple):
    """A fenced block of a document."""

    language: str
    text: str


class Command(NamedTuple):
    """A command of a document, with its shown output and exit status."""

    text: str
    output: list[str]
    status: int

    @property
    def is_plain(self) -> bool:
        """Whether it is one call of `symaware`, for which it takes no shell."""
        # A bracket would matter to a shell only if there were a file with such a name.
        unquoted = re.sub(r"""'.*?'|"[^"$`]*\"""", "", self.text)
        return self.text.startswith("symaware ") and not re.search(r"[|&;<>$*?`]", unquoted)

    def check(self, status: int | None, printed: str) -> None:
        assert status == self.status, f"$ {self.text}\n{printed}"
        assert not self.output or matches(self.output, printed.splitlines()), f"$ {self.text}\n{printed}"


def blocks(document: Path) -> Iterator[Block]:
    for found in re.finditer(r"(?ms)^```(\w+)\n(.*?)^```$", document.read_text(encoding="utf-8")):
        yield Block(found[1], found[2])


def commands(text: str) -> list[Command]:
    """Take a console session apart; `$ echo $?` tells the status of the command before it."""
    found: list[Command] = []
    for entry in re.split(r"(?m)^\$ ", text)[1:]:
        command, _, output = entry.partition("\n")
        if command == "echo $?":
            found[-1] = found[-1]._replace(status=int(output))
        else:
            found.append(Command(command, output.splitlines(), 0))
    return [command for command in found if command.text.startswith(("symaware ", "sed ", "python docs/"))]


def masked(line: str) -> str:
    for pattern in VOLATILE:
        line = re.sub(pattern, "~", line)
    return " ".join(line.split())


def matches(shown: list[str], printed: list[str]) -> bool:
    """Whether a session shows what was printed; a line `...` stands for any number of lines."""
    pattern = [r"(.*\n)*" if line.strip() == "..." else re.escape(masked(line)) + r"\n" for line in shown]
    return re.fullmatch("".join(pattern), "".join(f"{masked(line)}\n" for line in printed)) is not None


def ids(path: Path) -> str:
    return str(path.relative_to(TOP))


def having(*languages: str) -> list[Path]:
    return [document for document in DOCUMENTS if any(block.language in languages for block in blocks(document))]


#: How the block with the entry points of a plugin begins.
REGISTRATION = "[project.entry-points"


def registers(document: Path) -> bool:
    """Whether a document shows a plugin with its entry points."""
    return any(block.text.startswith(REGISTRATION) for block in blocks(document))


def installed(document: Path, folder: Path) -> None:
    """Install `my-package`, made of the Python and the entry points that a document shows, and each whole package."""
    found = list(blocks(document))
    code = [block.text for block in found if block.language == "python"]
    modules = {named[1]: text for text in code if (named := re.match(r"# (\w+)\.py\n", text))}
    lines = [block.text for block in found if block.text.startswith(REGISTRATION)]
    rest = "\n\n".join(text for text in code if text not in modules.values())
    packages = {"my-package": ("0.1.0", {"my_package": rest}, "".join(lines))}
    for block in found:
        if block.text.startswith("# pyproject.toml"):
            project = tomllib.loads(block.text)["project"]
            points = "".join(block.text.partition(REGISTRATION)[1:])
            packages[project["name"]] = (project["version"], modules, points)
    for name, (version, contents, entries) in packages.items():
        about = folder / "site" / f"{name.replace('-', '_')}-{version}.dist-info"
        about.mkdir(parents=True)
        for module, text in contents.items():
            about.with_name(f"{module}.py").write_text(text, encoding="utf-8")
        about.joinpath("METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8"
        )
        listed = entries.replace("project.entry-points.", "").replace('"', "")
        about.joinpath("entry_points.txt").write_text(listed, encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("scenarios", "sweeps"):
        shutil.copytree(TOP / name, tmp_path / name)
    for place in TOP.glob("plugins/*/scenarios"):
        shutil.copytree(place, tmp_path / place.relative_to(TOP))
    (tmp_path / "docs").mkdir()
    for script in (TOP / "docs").glob("*.py"):
        shutil.copy(script, tmp_path / "docs")
    tmp_path.joinpath("base.yaml").write_text(BASE, encoding="utf-8")
    return tmp_path


def written(block: Block, folder: Path, number: int) -> Path:
    """Write a snippet into a file: a scenario as it is, a part of one on top of `BASE`.

    A first line such as `# night.yaml` names the file, for those that come after it.
    """
    content = yaml.safe_load(block.text) if block.language == "yaml" else tomllib.loads(block.text)
    named = re.match(r"# (\S+\.(yaml|toml))$", block.text.partition("\n")[0])
    path = folder / (named[1] if named else f"snippet-{number}.{block.language}")
    text = block.text
    if not {"symaware", "symaware-sweep", "symaware-tolerance", "symaware-case", "extends"} & content.keys():
        text = ("extends: base.yaml\n" if block.language == "yaml" else 'extends = "base.yaml"\n') + text
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("document", having("console"), ids=ids)
def test_a_command_prints_what_the_document_shows(
    document: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands run in this process, except those for which it takes a shell, and those of `PROCESSES`.

    So do the runs of sweeps, of which other tests show that they do not depend on the number of worker processes.
    """
    scripts = str(Path(sys.executable).parent)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", os.pathsep.join([scripts, os.environ["PATH"]]))
    monkeypatch.setattr(terminal, "job_count", lambda jobs: jobs or 0)
    monkeypatch.delenv("COLUMNS", raising=False)  # Without the width of a terminal, lines are not folded.
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder / "configuration"))
    site = None
    if registers(document):
        installed(document, folder)
        site = folder / "site"
    places = [str(site) if site else "", os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, places))}
    for number, block in enumerate(blocks(document)):
        if block.language in ("yaml", "toml") and re.match(r"# (?!pyproject)", block.text):
            written(block, folder, number)
        if block.language == "python" and (named := re.match(r"# (\w+\.py)\n", block.text)):
            (folder / named[1]).write_text(block.text)
        if block.language != "console":
            continue
        started: list[tuple[Command, subprocess.Popen[str]]] = []
        for command in commands(block.text):
            if command.is_plain and ids(document) not in PROCESSES and not started:
                result = invoked(*shlex.split(command.text)[1:], site=site)
                command.check(result.exit_code, result.output)
                continue
            process = subprocess.Popen(
                ["bash", "-c", command.text.removesuffix("&")],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                env=environment,
            )
            # What runs beside others is over by the time that what runs in front of it is.
            started.append((command, process))
            while started and not command.text.endswith("&"):
                ended, process = started.pop()
                printed, _ = process.communicate(timeout=120)
                ended.check(process.returncode, printed)


def test_the_readme_shows_the_scenario_as_it_is() -> None:
    shown = [block.text for block in blocks(TOP / "README.md") if block.language == "yaml"]
    assert shown
    scenario = TOP.joinpath("scenarios", "hello.yaml").read_text(encoding="utf-8")
    assert all(text in scenario for text in shown)


@pytest.mark.parametrize("guide", ["scenario.md", "time.md"])
def test_every_snippet_of_a_guide_to_scenarios_is_sound(
    guide: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = TOP / "docs" / guide
    snippets = [block for block in blocks(document) if block.language in ("yaml", "toml")]
    snippets = [block for block in snippets if not block.text.startswith(REGISTRATION)]
    assert snippets
    if registers(document):
        installed(document, folder)
        monkeypatch.syspath_prepend(folder / "site")
    for number, block in enumerate(snippets):
        build(written(block, folder, number))


@pytest.mark.parametrize("document", having("python"), ids=ids)
def test_the_code_of_a_document_runs(document: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    reads_logs = "open_log" in document.read_text(encoding="utf-8")
    namespace: dict[str, object] = {"__name__": "document"}
    for number, block in enumerate(blocks(document)):
        if block.language in ("yaml", "toml") and re.match(r"# (?!pyproject)", block.text):
            written(block, folder, number)
        if block.language == "console" and reads_logs:
            # The logs that the code reads are those of the runs that the document shows.
            for command in commands(block.text):
                if command.text.startswith("symaware run scenarios/"):
                    assert invoked(*command.text.split()[1:]).exit_code == 0
        if block.language == "python":
            exec(compile(block.text, str(document), "exec"), namespace)


@pytest.mark.parametrize("document", DOCUMENTS, ids=ids)
def test_every_link_has_a_target(document: Path) -> None:
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", document.read_text(encoding="utf-8"))
    missing = [target for target in targets if "://" not in target and not (document.parent / target).exists()]
    assert not missing
