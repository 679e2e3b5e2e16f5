"""A release states one version everywhere, and lists its content and its sources."""

import hashlib
import json
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from checkout import CHECKOUT

import symaware_cli as sa
from symaware_cli.evidence.signed_statement import public_key_of, read_statement
from symaware_cli.language import execution
from symaware_cli.log.digest import digest


@pytest.fixture(scope="module")
def release() -> dict[str, Any]:
    return runpy.run_path(str(CHECKOUT / ".ci" / "release.py"))


def test_a_release_has_the_version_of_its_tag(release: dict[str, Any], tmp_path: Path) -> None:
    shutil.copy(CHECKOUT / "CHANGELOG.md", tmp_path)
    release["check_version"]("0.2.0", ["nightly", "v0.2.0"], tmp_path)
    release["check_version"]("0.2.1.dev3+g1234567", ["nightly"], tmp_path)
    with pytest.raises(Exception, match=r"tagged v9\.9\.9, and its version is 0\.2\.0"):
        release["check_version"]("0.2.0", ["v9.9.9"], tmp_path)


def test_a_release_needs_an_entry_with_a_date_that_has_all_fragments(release: dict[str, Any], tmp_path: Path) -> None:
    changes, fragment = tmp_path / "CHANGELOG.md", tmp_path / "changes" / "+speed.added.md"
    changes.write_text("## [0.3.0] - unreleased\n", encoding="utf-8")
    with pytest.raises(Exception, match=r"no entry with a date for 0\.3\.0"):
        release["check_version"]("0.3.0", ["v0.3.0"], tmp_path)
    changes.write_text("## [0.3.0] - 2027-01-01\n", encoding="utf-8")
    release["check_version"]("0.3.0", ["v0.3.0"], tmp_path)
    fragment.parent.mkdir()
    fragment.touch()
    with pytest.raises(Exception, match=r"\+speed\.added\.md is not in the changelog"):
        release["check_version"]("0.3.0", ["v0.3.0"], tmp_path)


def test_the_digest_of_a_log_does_not_depend_on_the_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = sa.load(CHECKOUT / "scenarios" / "hello.yaml")
    logs = []
    for version in ("0.2.0", "0.2.1.dev3+g1234567"):
        monkeypatch.setattr(execution, "versions", lambda version=version: {"symaware-cli": version})
        logs.append(sa.open_log(scenario.run(duration=0.5, output=tmp_path / f"{version}.mcap").log.path))
    assert len({log.attachments["versions.json"] for log in logs}) == 2
    assert len({digest(log).combined for log in logs}) == 1


def repository(folder: Path) -> Callable[..., None]:
    """Copy the checkout without its history into a new repository, and return a function that calls git there."""
    leave = shutil.ignore_patterns(".git", ".venv", ".*_cache", "__pycache__", "_site", ".peers")
    shutil.copytree(CHECKOUT, folder, ignore=leave, symlinks=True)
    # As those who make a release do, by `towncrier build`.
    for fragment in (folder / "changes").glob("*.md"):
        fragment.unlink()

    def git(*arguments: str) -> None:
        command = ["git", "-c", "user.name=a", "-c", "user.email=a@localhost", *arguments]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)

    git("init", "--quiet", "--initial-branch=main")
    git("add", ".")
    git("commit", "--quiet", "--message=All")
    return git


@pytest.mark.slow
def test_a_release_is_built_from_a_tag_works_alone_and_reports_its_version(tmp_path: Path) -> None:
    checkout, folder, key = tmp_path / "checkout", tmp_path / "dist", tmp_path / "key.pem"
    git = repository(checkout)
    git("tag", "v0.2.0")
    subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", key], check=True, capture_output=True)
    command = [sys.executable, str(checkout / ".ci" / "release.py"), str(folder), "--key", str(key)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    wheel, archive = "symaware_cli-0.2.0-py3-none-any.whl", "symaware_cli-0.2.0.tar.gz"
    names = {"SHA256SUMS", "provenance.json", "sbom.cdx.json", wheel, archive}
    assert {path.name for path in folder.iterdir()} == names
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=folder, check=True, capture_output=True)
    statement = read_statement((folder / "provenance.json").read_bytes())
    assert statement.is_signed_by(public_key_of(key))
    assert {each["name"] for each in statement.content["subject"]} == {wheel, archive}
    bill = json.loads((folder / "sbom.cdx.json").read_text(encoding="utf-8"))
    assert bill["metadata"]["component"]["version"] == "0.2.0"
    assert {"numpy", "matplotlib"} <= {each["name"] for each in bill["components"]}


@pytest.mark.slow
def test_the_version_is_found_in_tags_in_an_sdist_and_falls_back_in_other_copies(tmp_path: Path) -> None:
    def built(source: Path, name: str, *, kind: str = "wheel") -> str:
        options = ["--no-isolation"] if find_spec("hatch_vcs") else []
        command = [
            sys.executable,
            "-P",
            "-m",
            "build",
            *options,
            f"--{kind}",
            "--outdir",
            str(tmp_path / name),
            str(source),
        ]
        subprocess.run(command, check=True, capture_output=True)
        (found,) = (tmp_path / name).iterdir()
        return found.name.removeprefix("symaware_cli-").removesuffix("-py3-none-any.whl").removesuffix(".tar.gz")

    checkout = tmp_path / "checkout"
    git = repository(checkout)
    assert re.fullmatch(r"0\.2\.0\.dev1\+g[0-9a-f]+", built(checkout, "untagged"))
    git("tag", "v0.3.0")
    git("commit", "--quiet", "--allow-empty", "--message=More")
    assert re.fullmatch(r"0\.3\.1\.dev1\+g[0-9a-f]+", built(checkout, "after"))
    git("tag", "v0.3.1")
    assert built(checkout, "sdist", kind="sdist") == "0.3.1"
    with tarfile.open(tmp_path / "sdist" / "symaware_cli-0.3.1.tar.gz") as archive:
        archive.extractall(tmp_path, filter="data")
    assert built(tmp_path / "symaware_cli-0.3.1", "from-sdist") == "0.3.1"
    shutil.rmtree(checkout / ".git")
    assert built(checkout, "folder") == "0.2.0.dev0"


def test_a_fragment_becomes_an_entry_of_the_changelog(tmp_path: Path) -> None:
    for name in ("pyproject.toml", "CHANGELOG.md"):
        shutil.copy(CHECKOUT / name, tmp_path)
    (tmp_path / "changes").mkdir()
    (tmp_path / "changes" / "+speed.added.md").write_text("Robots have a speed.\n", encoding="utf-8")
    command = [sys.executable, "-m", "towncrier", "build", "--version", "0.9.0", "--date", "2027-01-01", "--yes"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    text = (tmp_path / "CHANGELOG.md").read_text(encoding="utf-8")
    assert "## [0.9.0] - 2027-01-01\n\n### Added\n\n- Robots have a speed.\n" in text
    assert text.index("## [0.9.0]") < text.index("## [0.2.0]")
    assert not [*(tmp_path / "changes").iterdir()]


def test_the_bill_of_materials_names_each_package_once(release: dict[str, Any]) -> None:
    packages = [
        {"name": "numpy", "version": "2.4.6", "license": "BSD-3-Clause"},
        {"name": "pip", "version": "26.0", "license": "MIT"},
        {"name": "symaware-cli", "version": "0.2.0", "license": "Apache-2.0"},
    ]
    bill = release["bill_of_materials"]("0.2.0", packages)
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    assert [each["purl"] for each in bill["components"]] == ["pkg:pypi/numpy@2.4.6"]
    assert bill["dependencies"][0]["dependsOn"] == ["pkg:pypi/numpy@2.4.6"]
    assert re.fullmatch(r"urn:uuid:[0-9a-f-]{36}", bill["serialNumber"])
    assert bill == release["bill_of_materials"]("0.2.0", packages)


def test_the_provenance_names_each_file_by_its_digest(release: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "symaware_cli-0.2.0.tar.gz"
    file.write_bytes(b"content")
    statement = release["provenance"]([file], "c" * 40)
    assert statement["subject"] == [{"name": file.name, "digest": {"sha256": hashlib.sha256(b"content").hexdigest()}}]
    assert "c" * 40 in json.dumps(statement["predicate"])
