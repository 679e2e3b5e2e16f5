"""Logs, and the reports on them, name the wheel, the commit or the URL from which SymAware was installed."""

import hashlib
import html
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path

import pytest
from checkout import CHECKOUT

from symaware_cli import open_log
from symaware_cli.language.package_origin import ORIGIN
from symaware_cli.studies.identity import counting

pytestmark = pytest.mark.slow

Installed = Callable[..., tuple[str | None, str]]


def git(folder: Path, *arguments: str) -> str:
    person = ("-c", "user.name=Somebody", "-c", "user.email=somebody@example.org", "-c", "commit.gpgsign=false")
    done = subprocess.run(["git", *person, *arguments], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository with what is needed to build SymAware."""
    folder = tmp_path / "sources"
    folder.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(CHECKOUT / name, folder)
    shutil.copytree(CHECKOUT / "symaware_cli", folder / "symaware_cli", ignore=shutil.ignore_patterns("__pycache__"))
    git(folder, "init", "--quiet", "--initial-branch=trunk")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--message=All of it")
    return folder


@pytest.fixture(params=["pip", "uv"])
def installed(request: pytest.FixtureRequest, tmp_path: Path) -> Installed:
    """Install something into a fresh environment, run a scenario there, and report on its log.

    Returns what the log notes, and the commands of the report that install the same.
    """
    uv = shutil.which("uv")
    if request.param == "uv" and uv is None:
        pytest.skip("uv is not installed here")
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    python = environment / "bin" / "python"
    packages = sysconfig.get_path("purelib", vars={"base": str(environment)})
    # Of the present environment it has everything else; what is installed in the fresh one comes first.
    Path(packages, "others.pth").write_text(sysconfig.get_path("purelib") + "\n")
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}

    def install(*what: object) -> tuple[str | None, str]:
        if uv and request.param == "uv":
            line: list[object] = [uv, "pip", "install", "--quiet", "--python", python, "--no-deps", "--reinstall"]
            line += ["--no-build-isolation"]
        else:
            line = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps"]
            line += ["--force-reinstall", "--no-warn-script-location", "--no-build-isolation"]
        subprocess.run([str(each) for each in (*line, *what)], check=True, env=kept, timeout=300)
        return described()

    def described() -> tuple[str | None, str]:
        log, page = tmp_path / "run.mcap", tmp_path / "run.html"
        scenario = CHECKOUT / "scenarios" / "hello.yaml"
        verbs = (["run", scenario, "--set", "run.duration=0.2", "-o", log, "--quiet"], ["report", log, "-o", page])
        for verb in verbs:
            line = [str(each) for each in (python, "-m", "symaware_cli", *verb)]
            subprocess.run(line, check=True, env=kept, cwd=tmp_path, timeout=300)
        (commands,) = re.findall(r"(?s)How to repeat it</h2>\s*<pre>(.*?)</pre>", page.read_text(encoding="utf-8"))
        return versions_of(log).get(ORIGIN), html.unescape(commands)

    install.described = described  # type: ignore[attr-defined]  # the same again, without installing
    return install


def versions_of(log: Path) -> dict[str, str]:
    found: dict[str, str] = json.loads(open_log(log).attachments["versions.json"])
    assert ORIGIN not in counting(found)
    return found


def test_a_wheel_is_named_with_its_hash(installed: Installed, repository: Path, tmp_path: Path) -> None:
    line = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*line, "--wheel-dir", str(tmp_path), str(repository)], check=True, timeout=300)
    (wheel,) = tmp_path.glob("*.whl")
    origin, commands = installed(wheel)
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    # Not every installer notes the hash.
    assert origin in (f"{wheel.name}, SHA-256 {digest}", wheel.name)
    assert f"pip install './{wheel.name}[all]'" in commands
    assert str(tmp_path) not in commands


def test_a_checkout_is_named_by_the_commit_that_is_checked_out(
    installed: Installed, repository: Path, tmp_path: Path
) -> None:
    first = git(repository, "rev-parse", "HEAD")
    origin, commands = installed("--editable", repository)
    assert origin == f"commit {first}"
    assert f"git checkout {first} " in commands
    assert str(tmp_path) not in commands
    git(repository, "commit", "--quiet", "--allow-empty", "--message=Further")
    second = git(repository, "rev-parse", "HEAD")
    again: Callable[[], tuple[str | None, str]] = installed.described  # type: ignore[attr-defined]  # see there
    for change in (("pack-refs", "--all"), ("checkout", "--quiet", "--detach")):
        git(repository, *change)
        assert again()[0] == f"commit {second}"
    git(repository, "worktree", "add", "--quiet", str(tmp_path / "beside"), first)
    assert installed("--editable", tmp_path / "beside")[0] == f"commit {first}"


def test_a_url_of_git_is_named_with_the_commit(installed: Installed, repository: Path) -> None:
    commit = git(repository, "rev-parse", "HEAD")
    origin, commands = installed(f"git+{repository.as_uri()}@trunk")  # older versions of pip want a host after a name
    assert origin == f"git+{repository.as_uri()}@{commit}"
    assert f"pip install 'symaware-cli[all] @ {origin}'" in commands


def test_sources_without_a_commit_are_not_named(installed: Installed, repository: Path) -> None:
    shutil.rmtree(repository / ".git")
    origin, commands = installed("--editable", repository)
    assert origin is None
    assert "its commit or wheel was not recorded" in commands
