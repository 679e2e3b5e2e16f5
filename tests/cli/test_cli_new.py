"""`symaware new`: a scenario, or a package of plugins, to start from."""

import ast
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from checkout import CHECKOUT
from simulating import COMMAND, Command
from typer.testing import CliRunner

from symaware_cli.cli.application import all_commands, application
from symaware_cli.cli.new import Purpose, Theme
from symaware_cli.cli.plugin_package import SCAFFOLDS, PluginScaffold, ScaffoldError, package_files, write_package
from symaware_cli.language.build import build
from symaware_cli.language.template import template

GROUPS = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]["entry-points"]

#: Groups of entry points without a kind of new packages.
WITHOUT_KIND = {"symaware.doors": "a kind of plugins of its own: it is for code that uses such plugins, not for users"}

KINDS = pytest.mark.parametrize("kind", SCAFFOLDS, ids=lambda kind: kind.folder)


def invoke(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(application, words)
    return done.exit_code, done.output


@pytest.mark.parametrize(("options", "name"), [([], "mine.yaml"), (["--toml"], "mine.toml")])
def test_the_written_scenario_is_valid_and_runs(
    options: list[str], name: str, command: Command, tmp_path: Path
) -> None:
    done = command("new", "mine", *options)
    assert done.returncode == 0
    assert f"symaware run {name}" in done.stdout
    assert os.listdir(tmp_path) == [name]
    run = command("run", name, "--set", "run.duration=1")
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "mine.mcap").exists()


def test_it_overwrites_nothing(command: Command, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("precious")
    done = command("new", "mine")
    assert done.returncode == 2
    assert done.stderr == "symaware: mine.yaml exists already\n"
    assert (tmp_path / "mine.yaml").read_text() == "precious"


@pytest.mark.parametrize("name", ["../mine", "a b", "", "9lives", "a/b", "x" * 300])
def test_a_name_that_cannot_be_one_is_refused(name: str, command: Command, tmp_path: Path) -> None:
    done = command("new", "--", name)
    assert done.returncode == 2
    assert done.stderr
    assert os.listdir(tmp_path) == []


def test_a_name_alone_is_that_of_a_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written = []
    for line in ("new mine", "new scenario mine", "new --toml mine", "new scenario mine --toml", "new -- mine"):
        written.append((invoke(*shlex.split(line)), [path.read_text() for path in tmp_path.iterdir()]))
        for path in tmp_path.iterdir():
            path.unlink()
    assert written[0] == written[1] == written[4]
    assert written[2] == written[3]
    assert written[0][0] == (0, "Wrote mine.yaml. Run it with: symaware run mine.yaml\n")
    # Also one that is the name of a command.
    assert invoke("new", "--", "plugin") == (0, "Wrote plugin.yaml. Run it with: symaware run plugin.yaml\n")


@pytest.mark.parametrize("theme", Theme)
def test_a_scenario_of_a_theme_is_sound_and_explains_itself(theme: Theme, tmp_path: Path) -> None:
    text = template("mine", like=theme)
    assert text.startswith("# mine: ")
    assert "# Look for " in text
    assert text.count("#") >= 12
    assert max(map(len, text.splitlines())) <= 130
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    built = build(path, ["run.duration=0.2"])
    assert built.document.name == "mine"


@pytest.mark.slow
@pytest.mark.parametrize("theme", Theme)
def test_a_scenario_of_a_theme_satisfies_its_specifications_within_half_a_minute(theme: Theme, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(template("mine", like=theme))
    built = build(path)
    assert built.document.run.duration <= 30.0
    assert built.document.specifications
    # That is: it finishes, and no specification is violated.
    assert invoke("run", str(path), "-q", "-o", str(tmp_path / "mine.mcap"))[0] == 0


def test_every_group_of_entry_points_has_a_kind_or_a_reason_to_have_none() -> None:
    written = {group for kind in SCAFFOLDS for group in kind.points}
    assert written.isdisjoint(WITHOUT_KIND)
    assert written | WITHOUT_KIND.keys() == GROUPS.keys()


def test_every_kind_has_an_option_and_its_templates() -> None:
    options = {f"--{each.name}" for each in all_commands()["new plugin"].params if each.param_type_name == "option"}
    assert options == {kind.option.partition(" ")[0] for kind in SCAFFOLDS}
    assert {kind.folder for kind in SCAFFOLDS if kind.option.startswith("--component ")} == set(Purpose)
    folders = {path.name for path in (CHECKOUT / "symaware_cli" / "cli" / "scaffold").iterdir()}
    assert folders == {"package", *(kind.folder for kind in SCAFFOLDS)}


@KINDS
def test_a_package_registers_what_it_defines_and_imports_the_public_interface_alone(kind: PluginScaffold) -> None:
    files = package_files("my-own", kind)
    assert {"pyproject.toml", "README.md", "tests/test_my_own.py", "scenarios/my-own.yaml"} <= files.keys()
    project = tomllib.loads(files["pyproject.toml"])["project"]
    assert project["dependencies"][0].startswith("symaware-cli")
    documented = (CHECKOUT / "docs" / "plugins.md").read_text(encoding="utf-8")
    for points in project["entry-points"].values():
        for target in points.values():
            module, _, name = target.partition(":")
            tree = ast.parse(files[f"src/{module.replace('.', '/')}.py"])
            assert name in {getattr(node, "name", None) for node in tree.body}
    for path, text in files.items():
        assert all(len(line) <= 120 and line == line.rstrip() for line in text.splitlines()), path
        assert text.endswith("\n"), path
        assert not re.search(r"\$[{a-z]", text), path
        if path.endswith(".py"):
            compile(text, path, "exec")
            assert ast.get_docstring(ast.parse(text)), path
            modules = set(re.findall(r"(?m)^(?:from|import) (symaware_cli[\w.]*)", text)) - {"symaware_cli"}
            assert {each for each in modules if each not in documented} == set(), path


@pytest.mark.parametrize(
    "name", ["../mine", "a b", "", "9lives", "a/b", "-a", "a-", "a--b", "a.b", "é", "class", "json", "numpy", "x" * 65]
)
def test_a_package_with_a_name_that_cannot_be_one_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(ScaffoldError, match="name"):
        write_package(tmp_path, name, SCAFFOLDS[0])
    assert os.listdir(tmp_path) == []


def test_a_package_overwrites_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    said = "Install and test it with: pip install -e my-own && pytest my-own"
    assert invoke("new", "plugin", "my-own", "--model") == (0, f"Wrote my-own. {said}\n")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert invoke("new", "plugin", "my-own", "--fault") == (2, "symaware: my-own exists already\n")
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_an_error_leaves_no_half_of_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written, write = [], Path.write_text

    def failing(path: Path, text: str, encoding: str | None = None) -> int:
        written.append(path)
        if len(written) == 4:
            raise OSError(28, "No space left on device")
        return write(path, text, encoding)

    monkeypatch.setattr(Path, "write_text", failing)
    with pytest.raises(ScaffoldError, match=r"cannot write .*my-own: no space left on device"):
        write_package(tmp_path, "my-own", SCAFFOLDS[0])
    assert len(written) == 4
    assert os.listdir(tmp_path) == []


#: Builds a wheel of each package that is named, with the backend that its pyproject.toml names.
BUILD = """
import os, sys
from setuptools import build_meta
top = os.getcwd()
for name in sys.argv[1:]:
    os.chdir(os.path.join(top, name))
    build_meta.build_wheel(os.path.join(top, "wheels"))
"""

#: Runs the scenario of each package that is named.
RUN = """
import sys
from symaware_cli.cli.application import application
names = sys.argv[1:]
for name in names:
    try:
        application(["run", f"{name}/scenarios/{name}.yaml", "--output", f"{name}.mcap"])
    except SystemExit as end:
        if end.code:
            raise
"""


@pytest.mark.slow
def test_a_package_of_each_kind_is_green_without_an_edit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Written, installed, tested, listed and run outside of the checkout; by one command where it takes several."""

    def call(*line: str | Path) -> str:
        # Where this package is, for a checkout that is not the one installed; then where the new package is.
        path = os.pathsep.join([str(tmp_path / "site"), str(CHECKOUT)])
        done = subprocess.run(
            list(map(str, line)),
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=1800,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    monkeypatch.chdir(tmp_path)
    names = {f"my-{kind.folder}": kind for kind in SCAFFOLDS}
    for name, kind in names.items():
        assert invoke("new", "plugin", name, *kind.option.split())[0] == 0
    # Pip would start three processes for each package; what it calls there builds all but one of them in a single one.
    first, *rest = names
    call(sys.executable, "-c", BUILD, *rest)
    wheels = sorted((tmp_path / "wheels").iterdir())
    assert len(wheels) == len(rest)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    call(*pip, "--no-deps", "--no-build-isolation", "--target", "site", f"./{first}", *wheels)
    assert f"{len(names)} passed" in call(sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *names)
    listed = call(*COMMAND, "--help") + call(*COMMAND, "list")
    for name, kind in names.items():
        for points in kind.points.values():
            for point in points:
                own = point.replace("$name", name).replace("${module}", name.replace("-", "_"))
                assert re.search(rf"(?m)^\W*{re.escape(own)}\s", listed), own
    call(sys.executable, "-c", RUN, *names)
    assert {f"{name}.mcap" for name in names} <= set(os.listdir(tmp_path))
