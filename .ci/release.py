"""Builds a release, checks it in fresh environments, and describes it. Nothing is uploaded.

    .venv/bin/python .ci/release.py FOLDER [--python INTERPRETER]... [--key KEY]

Builds the last commit, whose version is that of its tag (`v0.2.0`); without a tag it is a trial, with a version such as
`0.2.0.dev7+g1234567`. Writes into FOLDER: the sdist, the wheel that is built from it, `sbom.cdx.json` (CycloneDX 1.6:
what an installation with the extra `plot` consists of), `provenance.json` (an in-toto statement with the predicate of
SLSA, signed if a key of Ed25519 is given: it says from which commit the files were built) and `SHA256SUMS`. Each
interpreter installs the wheel with the pins, runs and verifies a new scenario, executes a notebook, and must give the
same digest of the run as the others.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from symaware_cli import LogError
from symaware_cli.evidence.signed_statement import TYPE, written

TOP = Path(__file__).resolve().parents[1]
NOTEBOOKS = TOP / "docs" / "notebooks"

#: What a fresh environment prints about its packages, as JSON.
LISTING = """
import json
from importlib.metadata import distributions
found = {d.metadata["Name"].lower().replace("_", "-"): d for d in distributions()}
print(json.dumps([{"name": name, "version": d.version, "license": d.metadata.get("License-Expression") or ""}
                  for name, d in sorted(found.items())]))
"""


class ReleaseError(Exception):
    """The release is not as it should be."""


def main() -> None:
    """Build, check and describe the release."""
    parser = argparse.ArgumentParser(description="Build and check a release.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--python", action="append", default=[], metavar="INTERPRETER")
    parser.add_argument("--key", type=Path, help="signs the provenance: a private key of Ed25519 in PEM")
    arguments = parser.parse_args()
    folder: Path = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise ReleaseError(f"{folder} is not empty")
    commit = output("git", "rev-parse", "HEAD", at=TOP)
    built(folder, commit)
    files = sorted(folder.iterdir())
    (wheel,) = (path for path in files if path.suffix == ".whl")
    version = wheel.name.split("-")[1]
    check_version(version, output("git", "tag", "--points-at", commit, at=TOP).split(), TOP)
    checked = [checked_in(python, wheel) for python in arguments.python or [sys.executable]]
    if len({digest for digest, _ in checked}) != 1:
        raise ReleaseError("the digest of a run differs between the interpreters")
    bill = json.dumps(bill_of_materials(version, checked[0][1]), indent=2)
    (folder / "sbom.cdx.json").write_text(bill + "\n", encoding="utf-8")
    (folder / "provenance.json").write_bytes(written(provenance(files, commit), arguments.key))
    listed = sorted(folder.iterdir())
    (folder / "SHA256SUMS").write_text("".join(f"{sha256(path)}  {path.name}\n" for path in listed))
    print(f"{folder}: {', '.join(path.name for path in listed)}; checked with {len(checked)} interpreters")


def check_version(version: str, tags: Sequence[str], checkout: Path) -> None:
    """Check the version of a commit: that of its tag, if it has one, with an entry in the changelog.

    Raises:
        ReleaseError: The tag is another one, or the changelog of a tagged version is not complete.
    """
    released = [tag for tag in tags if re.match(r"v\d", tag)]
    if not released:
        return
    if released != [f"v{version}"]:
        raise ReleaseError(f"the commit is tagged {', '.join(released)}, and its version is {version}")
    if not re.search(
        rf"(?m)^## \[{re.escape(version)}\] - \d", (checkout / "CHANGELOG.md").read_text(encoding="utf-8")
    ):
        raise ReleaseError(f"CHANGELOG.md has no entry with a date for {version}: towncrier build --version {version}")
    if fragments := sorted((checkout / "changes").glob("*.md")):
        raise ReleaseError(f"{fragments[0].name} is not in the changelog yet: towncrier build --version {version}")


def built(folder: Path, commit: str) -> None:
    """Build the sdist of a commit, and the wheel from the sdist, with the time of the commit in both."""
    time = output("git", "show", "--no-patch", "--format=%ct", commit, at=TOP)
    with tempfile.TemporaryDirectory() as copy:
        # A clone, since the version is found in the tags.
        output("git", "clone", "--quiet", "--shared", "--no-checkout", str(TOP), copy, at=TOP)
        output("git", "checkout", "--quiet", commit, at=Path(copy))
        environment = {**os.environ, "SOURCE_DATE_EPOCH": time}
        command = [sys.executable, "-P", "-m", "build", "--outdir", str(folder), copy]
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)


def checked_in(python: str, wheel: Path) -> tuple[str, list[dict[str, str]]]:
    """Use a wheel in a fresh environment; return the digest of a run, and the packages of the environment."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([python, "-m", "venv", "env"], cwd=folder, check=True)
        own = str(Path(folder, "env", "bin", "python"))
        install = [own, "-m", "pip", "install", "--quiet", "--no-compile", "-c", str(TOP / "constraints.txt")]
        subprocess.run([*install, f"{wheel}[plot]"], cwd=folder, check=True)
        packages: list[dict[str, str]] = json.loads(output(own, "-c", LISTING, at=Path(folder)))
        symaware = [own, "-P", "-m", "symaware_cli"]
        for line in ("new mine", "run mine.yaml --quiet", "plot mine.mcap", "verify mine.mcap --quiet"):
            subprocess.run([*symaware, *line.split()], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        digest = output(*symaware, "log", "digest", "mine.mcap", at=Path(folder)).split()[-1]
        # What executes notebooks, and nothing else.
        subprocess.run([*install, "ipykernel", "nbclient"], cwd=folder, check=True)
        notebook = shutil.copy(NOTEBOOKS / "first-scenario.ipynb", folder)
        subprocess.run(
            [own, "-P", str(NOTEBOOKS / "execute.py"), notebook], cwd=folder, check=True, stdout=subprocess.DEVNULL
        )
        return digest, packages


def bill_of_materials(version: str, packages: Sequence[Mapping[str, str]]) -> dict[str, Any]:
    """Return which packages an installation consists of, in the format CycloneDX 1.6."""
    components = [
        {
            "type": "library",
            "bom-ref": f"pkg:pypi/{each['name']}@{each['version']}",
            "name": each["name"],
            "version": each["version"],
            "purl": f"pkg:pypi/{each['name']}@{each['version']}",
            **({"licenses": [{"expression": each["license"]}]} if each["license"] else {}),
        }
        for each in packages
        if each["name"] not in ("symaware-cli", "pip", "setuptools")
    ]
    reference = f"pkg:pypi/symaware-cli@{version}"
    content: dict[str, Any] = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": reference,
                "name": "symaware-cli",
                "version": version,
                "purl": reference,
                "licenses": [{"expression": "Apache-2.0"}],
            }
        },
        "components": components,
        "dependencies": [{"ref": reference, "dependsOn": [each["bom-ref"] for each in components]}],
    }
    # The same content has the same number, so that a release can be built again.
    content["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(content, sort_keys=True))}"
    return content


def provenance(files: Sequence[Path], commit: str) -> dict[str, Any]:
    """Return from what files were built: an in-toto statement, version 1, with the predicate of SLSA 1.0."""
    return {
        "_type": TYPE,
        "subject": [{"name": path.name, "digest": {"sha256": sha256(path)}} for path in files],
        "predicateType": "https://slsa.dev/provenance/v1",
        "predicate": {
            "buildDefinition": {
                "buildType": "urn:symaware:release:1",
                "externalParameters": {"command": "python .ci/release.py"},
                "resolvedDependencies": [{"name": "source", "digest": {"gitCommit": commit}}],
            },
            "runDetails": {"builder": {"id": "urn:symaware:local-build"}},
        },
    }


def sha256(path: Path) -> str:
    """Return the digest of a file in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def output(*command: str, at: Path) -> str:
    """Return what a command prints."""
    return subprocess.run(command, cwd=at, check=True, capture_output=True, text=True).stdout.strip()


if __name__ == "__main__":
    try:
        main()
    except (ReleaseError, LogError) as failure:
        sys.exit(f"release: {failure}")
    except subprocess.CalledProcessError as failure:
        sys.exit(f"release: {failure}\n{failure.stderr or ''}")
