"""The verbs of the command: found among entry points, imported when used, and added by plugins."""

import importlib
import inspect
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

import pytest
import typer
from checkout import CHECKOUT
from simulating import Command, in_process

import symaware_cli
from symaware_cli.cli.application import all_commands
from symaware_cli.cli.verb_summaries import SUMMARIES
from symaware_cli.help_place import GROUPS, place_of

DECLARED: Mapping[str, str] = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]["entry-points"][
    "symaware.commands"
]

SPEED = '''
import typer
from typing import Annotated
from symaware_cli import in_help

@in_help("check", 15)
def speed(log: Annotated[str, typer.Argument(help="A log of a run.")], most: float = 1.0) -> None:
    """Check speeds.

    Further text.
    """
    from symaware_cli import open_log

    typer.echo(f"{log} {most} {open_log(log).path}")

def plain() -> None:
    """Be in no group."""

group = typer.Typer(help="Have commands of its own.")
in_help("weather")(group)

@group.command()
def wind(strength: int) -> None:
    """Blow."""
    typer.echo("blown" * strength)

@group.command()
def rain() -> None:
    """Fall."""
'''

FAULTS = {
    "raising": (
        "raise RuntimeError('no licence')\n",
        "cannot be imported: RuntimeError: no licence (raising.py, line 1)",
    ),
    "leaving": ("import sys; sys.exit(0)\n", "cannot be imported: SystemExit: 0 (leaving.py, line 1)"),
    "lacking": (
        "import nobody_has_this\n",
        "cannot be imported: No module named 'nobody_has_this' (lacking.py, line 1)",
    ),
    "syntactic": ("def syntactic(:\n", "cannot be imported: SyntaxError"),
    "absent": ("", "cannot be imported: AttributeError: module 'absent' has no attribute 'absent'"),
    "numeric": ("numeric = 3\n", "is not a function or a Typer application"),
    "signed": ("def signed(what: 'Nothing') -> None: ...\n", "has a faulty signature: NameError"),
    "typed": ("def typed(what: complex | bytes | dict[int, str]) -> None: ...\n", "has a faulty signature"),
}
"""Modules whose verb, of the same name, cannot be used; with the reason."""


def install(site: Path, package: str, modules: Mapping[str, str], verbs: Mapping[str, str]) -> None:
    """Put a distribution with verbs into a folder."""
    about = site / f"{package.replace('-', '_')}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n\nName: other\n")
    lines = [f"{name} = {target}" for name, target in verbs.items()]
    (about / "entry_points.txt").write_text("\n".join(["[symaware.commands]", *lines, ""]))
    for module, code in modules.items():
        (site / f"{module}.py").write_text(code)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder whose packages the command finds."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    return folder


@pytest.fixture
def sound(site: Path) -> None:
    """A package with sound verbs."""
    install(
        site, "speedy", {"speedy": SPEED}, {"speed": "speedy:speed", "plain": "speedy:plain", "weather": "speedy:group"}
    )


def sections(text: str) -> dict[str, list[str]]:
    """The entries of each section of a help without frames, on one line each."""
    found: dict[str, list[str]] = {}
    for part in text.split("\n\n"):
        title, *lines = part.strip("\n").splitlines()
        if not title.startswith(" ") and title.endswith(":"):
            entries: list[str] = []
            for line in lines:
                if line.startswith("   "):
                    entries[-1] += f" {line.strip()}"
                else:
                    entries.append(line.strip())
            found[title.rstrip(":")] = [" ".join(entry.split()) for entry in entries]
    return found


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of a short run."""
    path = tmp_path_factory.mktemp("logs") / "hello.mcap"
    symaware_cli.load(CHECKOUT / "scenarios" / "hello.yaml", ["run.duration=0.5"]).run(output=path)
    return path


def imported(line: list[str], folder: Path) -> set[str]:
    """The modules that a command line imports."""
    code = (
        f"import sys; sys.argv = ['symaware', *{line!r}]\ntry:\n from symaware_cli.cli import main; main()\nfinally:\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", f"{code} print('imported', *sys.modules)"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return set(done.stdout.splitlines()[-1].split())


def completed(*words: str) -> list[str]:
    """What Bash is offered for the last of some words."""
    environment = {
        **os.environ,
        "_SYMAWARE_COMPLETE": "complete_bash",
        "COMP_WORDS": " ".join(["symaware", *words]),
        "COMP_CWORD": str(len(words)),
    }
    done = subprocess.run(
        [Path(sys.executable).parent / "symaware"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    return done.stdout.split()


def test_every_verb_of_this_package_is_declared_and_in_a_group_of_the_help() -> None:
    found = all_commands()
    assert {name.partition(" ")[0] for name in found} == set(DECLARED)
    for target in DECLARED.values():
        module, _, name = target.partition(":")
        assert place_of(getattr(sys.modules[module], name)).group in GROUPS, target


def test_the_help_lists_the_verbs_of_plugins_in_their_groups(sound: None, site: Path) -> None:
    listed = sections(in_process("--help", site=site).stdout)
    assert list(listed)[1:] == [*GROUPS.values(), "weather", "Other commands"]
    assert [line.split()[0] for line in listed["Check"]][:3] == ["validate", "plan", "speed"]
    assert "speed Check speeds." in listed["Check"]
    assert listed["weather"] == ["weather Have commands of its own."]
    assert listed["Other commands"] == ["plain Be in no group."]


def test_the_verb_of_a_plugin_is_like_any_other(process: Command, sound: None, log: Path) -> None:
    done = process("speed", log, "--most", "2")
    assert (done.returncode, done.stdout) == (0, f"{log} 2.0 {log}\n")
    described = process("speed", "--help").stdout
    assert "A log of a run." in described
    assert "Of speedy 1.0." in described
    assert process("weather", "wind", "2").stdout == "blownblown\n"
    assert sections(process("weather", "-h").stdout)["Commands"] == ["wind Blow.", "rain Fall."]
    assert completed("sp") == ["speed"]
    assert completed("speed", "--mo") == ["--most"]
    assert completed("weather", "w") == ["wind"]
    misspelt = process("speeed")
    assert misspelt.returncode == 2
    assert "No such command 'speeed'. Did you mean 'speed'" in misspelt.stderr
    assert process("speed").returncode == 2


def test_errors_of_logs_and_scenarios_are_reported_for_the_verb_of_a_plugin(process: Command, sound: None) -> None:
    done = process("speed", "missing.mcap")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "symaware: there is no file missing.mcap\n"


def test_a_verb_that_cannot_be_used_breaks_no_other(site: Path, log: Path) -> None:
    install(
        site,
        "faulty-verbs",
        {name: code for name, (code, _) in FAULTS.items()},
        {name: f"{name}:{name}" for name in FAULTS},
    )
    listed = in_process("--help", site=site)
    assert listed.returncode == 0
    shown = sections(listed.stdout)
    unusable = {line.split()[0]: line for line in shown.pop("Cannot be used")}
    assert unusable.keys() == FAULTS.keys()
    assert set(DECLARED) <= {line.split()[0] for lines in shown.values() for line in lines}
    assert in_process("inspect", log, site=site).returncode == 0
    for name, (_, reason) in FAULTS.items():
        said = f"the command `{name}` of faulty-verbs 1.0 {reason}"
        assert said[:60] in unusable[name]
        for line in ([name], [name, "--help"], [name, "some", "--thing", "3"]):
            done = in_process(*line, site=site)
            assert (done.returncode, done.stdout) == (2, "")
            assert done.stderr.startswith(f"symaware: {said}")
            assert "Traceback" not in done.stderr
    assert "no licence" in json.loads(in_process("raising", "--json", site=site).stdout)["error"]
    assert completed("rais") == []


def test_a_verb_of_this_package_cannot_be_replaced(process: Command, site: Path, log: Path) -> None:
    install(site, "impostor", {"impostor": "def inspect() -> None: print('mine')\n"}, {"inspect": "impostor:inspect"})
    assert "finished" in process("inspect", log).stdout
    listed = sections(process("--help").stdout)
    assert "inspect" in [line.split()[0] for line in listed["Look at results"]]
    assert listed["Cannot be used"] == [
        "inspect the command `inspect` of impostor 1.0 is ignored: `symaware inspect` is built in"
    ]
    assert completed("insp") == ["inspect"]


def test_a_verb_that_two_packages_register_belongs_to_neither(site: Path) -> None:
    for package in ("first", "second"):
        install(site, package, {package: "def twice() -> None: print('run')\n"}, {"twice": f"{package}:twice"})
    done = in_process("twice", site=site)
    said = "the command `twice` is registered by first and second; uninstall one of them"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"symaware: {said}\n")
    assert sections(in_process("--help", site=site).stdout)["Cannot be used"] == [f"twice {said}"]


@pytest.mark.parametrize("verb", ["validate", "speed"])
def test_a_verb_imports_no_other(verb: str, sound: None, tmp_path: Path, log: Path) -> None:
    given = {"validate": CHECKOUT / "scenarios" / "hello.yaml", "speed": log}[verb]
    modules = imported([verb, str(given)], tmp_path)
    verbs = {target.partition(":")[0] for target in [*DECLARED.values(), "speedy"]}
    assert modules & verbs == ({"speedy"} if verb == "speed" else {"symaware_cli.cli.validate"})


def test_the_version_looks_at_no_package(sound: None, tmp_path: Path) -> None:
    modules = imported(["--version"], tmp_path)
    assert not modules & {"importlib.metadata", "typer", "speedy", "symaware_cli.entry_points"}


def test_what_the_help_says_of_verbs_without_importing_them_is_up_to_date() -> None:
    stale = "run python schemas/verb_summaries.py"
    assert set(SUMMARIES) == set(DECLARED.values()), stale
    for target, (text, *place) in SUMMARIES.items():
        module, _, name = target.partition(":")
        verb = getattr(importlib.import_module(module), name)
        described = verb.info.help if isinstance(verb, typer.Typer) else inspect.getdoc(verb)
        assert described is not None
        assert (text, *place) == (described.partition("\n\n")[0], *place_of(verb)), stale


def test_the_help_imports_no_verb_of_this_package(sound: None, tmp_path: Path) -> None:
    modules = imported(["--help"], tmp_path)
    assert "speedy" in modules
    assert not modules & ({target.partition(":")[0] for target in DECLARED.values()} | {"numpy", "pydantic"})


def test_an_installation_without_entry_points_says_so(tmp_path: Path) -> None:
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "symaware_cli").symlink_to(CHECKOUT / "symaware_cli")
    found = [path for path in sys.path if path.endswith("site-packages")]
    hidden = f"import sys; sys.path = [p for p in sys.path if p not in {found!r}]\n"
    code = f"""{hidden}
import os
sys.path += {found!r}
names = os.listdir
os.listdir = lambda folder: [name for name in names(folder) if not name.endswith("-info")]
sys.argv = ["symaware", "run"]
from symaware_cli.cli import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert done.stderr == "symaware: this installation is incomplete: install symaware-cli again with pip\n"
