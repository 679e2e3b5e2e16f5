"""Builds a release, checks it in fresh environments, and describes it. Nothing is uploaded.

    .venv/bin/python .ci/release.py FOLDER [--python INTERPRETER]...

Writes into FOLDER: the sdist, the wheel that is built from it, `sbom.cdx.json` (CycloneDX 1.6: what an installation
with the extra `plot` consists of), `provenance.json` (an in-toto statement with the predicate of SLSA, not signed: it
says from which commit the files were built, and proves nothing by itself) and `SHA256SUMS`. Each interpreter installs
the wheel with the pins, runs and verifies a new scenario, and must give the same digest as the others.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

TOP = Path(__file__).resolve().parents[1]

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
    arguments = parser.parse_args()
    folder: Path = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise ReleaseError(f"{folder} is not empty")
    commit = output("git", "rev-parse", "HEAD", at=TOP)
    check_version(version_of(TOP), tags_at(commit))
    built(folder, commit)
    files = sorted(folder.iterdir())
    (wheel,) = (path for path in files if path.suffix == ".whl")
    checked = [checked_in(python, wheel) for python in arguments.python or [sys.executable]]
    if len({digest for digest, _ in checked}) != 1:
        raise ReleaseError("the digest of a run differs between the interpreters")
    documents = {
        "sbom.cdx.json": bill_of_materials(version_of(TOP), checked[0][1]),
        "provenance.json": provenance(files, commit),
    }
    for name, document in documents.items():
        (folder / name).write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    listed = [path for path in sorted(folder.iterdir()) if path.is_file()]
    (folder / "SHA256SUMS").write_text("".join(f"{sha256(path)}  {path.name}\n" for path in listed))
    print(f"{folder}: {', '.join(path.name for path in listed)}; checked with {len(checked)} interpreters")


def version_of(checkout: Path) -> str:
    """Return the version that a checkout states."""
    found = re.search(r'__version__ = "([^"]+)"', (checkout / "symaware_cli" / "version.py").read_text())
    if found is None:
        raise ReleaseError("symaware_cli/version.py states no version")
    return found[1]


def tags_at(commit: str) -> list[str]:
    """Return the tags of a commit."""
    return output("git", "tag", "--points-at", commit, at=TOP).split()


def check_version(version: str, tags: Sequence[str]) -> None:
    """Check that a version is that of the tag of its commit, if there is one, and has an entry in the changelog."""
    others = [tag for tag in tags if tag.startswith("v") and tag != f"v{version}"]
    if others:
        raise ReleaseError(f"the commit is tagged {', '.join(others)}, and its version is {version}")
    if f"## [{version}]" not in (TOP / "CHANGELOG.md").read_text(encoding="utf-8"):
        raise ReleaseError(f"CHANGELOG.md has no entry for {version}")


def built(folder: Path, commit: str) -> None:
    """Build the sdist of a commit, and the wheel from the sdist, with the time of the commit in both."""
    time = output("git", "show", "--no-patch", "--format=%ct", commit, at=TOP)
    with tempfile.TemporaryDirectory() as copy:
        archive = subprocess.run(["git", "archive", commit], cwd=TOP, check=True, capture_output=True).stdout
        subprocess.run(["tar", "-x", "-C", copy], input=archive, check=True)
        environment = {**os.environ, "SOURCE_DATE_EPOCH": time}
        command = [sys.executable, "-P", "-m", "build", "--outdir", str(folder), copy]
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)


def checked_in(python: str, wheel: Path) -> tuple[str, list[dict[str, str]]]:
    """Use a wheel in a fresh environment; return the digest of a run, and the packages of the environment."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([python, "-m", "venv", "env"], cwd=folder, check=True)
        own = str(Path(folder, "env", "bin", "python"))
        pins = str(TOP / "constraints.txt")
        subprocess.run([own, "-m", "pip", "install", "--quiet", "-c", pins, f"{wheel}[plot]"], cwd=folder, check=True)
        packages: list[dict[str, str]] = json.loads(output(own, "-c", LISTING, at=Path(folder)))
        symaware = [own, "-P", "-m", "symaware_cli"]
        for line in ("new mine", "run mine.yaml --quiet", "plot mine.mcap", "verify mine.mcap --quiet"):
            subprocess.run([*symaware, *line.split()], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        return output(*symaware, "log", "digest", "mine.mcap", at=Path(folder)).split()[-1], packages


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
        "_type": "https://in-toto.io/Statement/v1",
        "subject": [{"name": path.name, "digest": {"sha256": sha256(path)}} for path in files],
        "predicateType": "https://slsa.dev/provenance/v1",
        "predicate": {
            "buildDefinition": {
                "buildType": "urn:symaware:release:1",
                "externalParameters": {"command": "python .ci/release.py"},
                "resolvedDependencies": [{"name": "source", "digest": {"gitCommit": commit}}],
            },
            "runDetails": {"builder": {"id": "urn:symaware:unsigned-local-build"}},
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
    except (ReleaseError, subprocess.CalledProcessError) as failure:
        sys.exit(f"release: {failure}")
