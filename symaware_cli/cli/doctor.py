"""``symaware doctor``."""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Annotated

import typer

from symaware_cli.cli.self_test import BROKEN, MISSING, MODULES, UNKNOWN, WORKS
from symaware_cli.cli.terminal import DATA_LOST, Json, print_json, printable, say
from symaware_cli.help_place import in_help

#: Extras that are no feature: all others together, and the tools to develop this package.
_COLLECTIONS = ("all", "dev")

#: How long an attempt may take [s].
_LONGEST = 120.0

_AGAIN = "pip install --force-reinstall {}"


@dataclass(frozen=True, slots=True)
class InstallationFact:
    """The state of a part of the installation.

    Attributes:
        name: The part.
        status: ``works``; ``missing``, if it is optional and not installed; ``broken``, if it is installed and does not
            work; or ``unknown``, if it could not be tried.
        message: The version of the part, or the problem with it.
        remedy: How to repair or install the part; empty if nothing has to be done.
    """

    name: str
    status: str
    message: str
    remedy: str = ""


@in_help("author", 60)
def doctor(
    quick: Annotated[
        bool, typer.Option("--quick", help="Only say what is installed; try no worlds, solvers and viewers.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List the parts of the installation, whether they work, and how to repair those that do not.

    Exit status 3 if an installed part does not work. Missing optional parts are no error.
    """
    found = []
    for each in _diagnosed(quick=quick):
        found.append(each)
        if not as_json:
            mark = {WORKS: "ok", MISSING: "-", BROKEN: "BROKEN", UNKNOWN: "?"}[each.status]
            say(f"{mark:<7} {printable(each.name):<22} {printable(each.message)}".rstrip())
            if each.remedy:
                say(f"{'':<30} {printable(each.remedy)}")
    broken = [each.name for each in found if each.status == BROKEN]
    if as_json:
        print_json({"works": not broken, "found": [asdict(each) for each in found]})
    else:
        say(f"broken: {', '.join(map(printable, broken))}" if broken else "nothing that is installed is broken")
    raise typer.Exit(DATA_LOST if broken else 0)


def _diagnosed(*, quick: bool) -> Iterator[InstallationFact]:
    from symaware_cli import processor
    from symaware_cli.version import __version__

    yield InstallationFact(
        "symaware", WORKS, f"{__version__}, Python {platform.python_version()}, {platform.platform()}"
    )
    import numpy as np  # so that its kernels can be asked for

    yield _kernels(processor.in_force(), processor.shortfall(), np.__version__)
    yield _compiled()
    yield from _extras()
    yield from _folders()
    yield from _plugins()
    if quick:
        return
    yield from _worlds()
    with tempfile.TemporaryDirectory() as folder:
        for name in MODULES:
            yield _tried(name, name, folder)


def _kernels(in_force: dict[str, str], shortfall: str | None, version: str) -> InstallationFact:
    said = f"NumPy {version} uses {in_force['NumPy kernels']}; {in_force['BLAS']}; pinned: {in_force['Pinned']}"
    if shortfall:
        remedy = "unset NPY_DISABLE_CPU_FEATURES, NPY_ENABLE_CPU_FEATURES and OPENBLAS_CORETYPE"
        return InstallationFact("kernels", UNKNOWN, said, remedy)
    return InstallationFact("kernels", WORKS, said)


def _compiled() -> InstallationFact:
    """Return whether functions on arrays are the compiled ones of the optional package."""
    from symaware_cli.geometry import why_not_compiled

    problem = why_not_compiled()
    if not problem:
        return InstallationFact("compiled functions", WORKS, f"symaware-compiled {_version('symaware-compiled')}")
    if _version("symaware-compiled") is None:
        remedy = "pip install ./plugins/symaware-compiled, in a clone; runs are the same without it, and slower"
        return InstallationFact("compiled functions", MISSING, problem, remedy)
    return InstallationFact("compiled functions", BROKEN, problem, _AGAIN.format("symaware-compiled"))


def _extras() -> Iterator[InstallationFact]:
    """Yield which packages of each extra are installed."""
    from symaware_cli.entry_points import DISTRIBUTION

    needed: dict[str, list[str]] = {}
    for requirement in metadata.requires(DISTRIBUTION) or ():
        name, _, marker = requirement.partition(";")
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", marker)
        if extra and extra[1] not in _COLLECTIONS and _is_for_this_python(marker):
            needed.setdefault(extra[1], []).append(re.split(r"[\s<>=!~\[]", name.strip())[0])
        elif extra and extra[1] not in _COLLECTIONS:
            needed.setdefault(extra[1], [])
    for named, names in sorted(needed.items()):
        versions = {name: _version(name) for name in names}
        missing = [name for name, version in versions.items() if version is None]
        if not names:
            said = f"there are no packages of it for Python {platform.python_version()}"
            yield InstallationFact(f"extra {named}", MISSING, said, "it needs an older Python; do without it otherwise")
        elif missing:
            yield InstallationFact(
                f"extra {named}",
                MISSING,
                f"not installed: {', '.join(missing)}",
                f"pip install '{DISTRIBUTION}[{named}]'",
            )
        else:
            yield InstallationFact(
                f"extra {named}", WORKS, ", ".join(f"{name} {version}" for name, version in versions.items())
            )


def _is_for_this_python(marker: str) -> bool:
    """Whether the condition of a requirement on the version of Python, if it has one, is true."""
    bound = re.search(r"python_version < ['\"](\d+)\.(\d+)['\"]", marker)
    return bound is None or sys.version_info[:2] < (int(bound[1]), int(bound[2]))


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _folders() -> Iterator[InstallationFact]:
    """Yield whether files can be written where they have to be."""
    from symaware_cli.plugin_files.file_trust import kept_folder

    try:
        with tempfile.NamedTemporaryFile() as file:
            file.write(b"x")
        yield InstallationFact("temporary files", WORKS, f"{tempfile.gettempdir()} can be written")
    except OSError as error:
        yield InstallationFact(
            "temporary files", BROKEN, f"cannot be written: {error}", "set TMPDIR to a folder with space"
        )
    folder = kept_folder()
    there = next(each for each in (folder, *folder.parents) if each.exists())
    if there.is_dir() and os.access(there, os.W_OK | os.X_OK):
        yield InstallationFact("configuration", WORKS, f"{folder} can be written")
    else:
        remedy = "`symaware trust` cannot keep what is trusted: set XDG_CONFIG_HOME, or use --trust"
        yield InstallationFact("configuration", UNKNOWN, f"{there} cannot be written", remedy)


def _plugins() -> Iterator[InstallationFact]:
    """Yield the packages with plugins, and which plugins cannot be imported."""
    from symaware_cli.cli.plugin_catalogue import every_plugin
    from symaware_cli.entry_points import DISTRIBUTION, PluginError

    catalogue = every_plugin()
    packages: dict[str, list[str]] = {}
    for kind in catalogue.kinds:
        for listing in catalogue.listings(kind):
            if not listing.built_in and not catalogue.is_shadowed(listing):
                failed = packages.setdefault(f"{listing.package} {listing.version}".strip(), [])
                try:
                    catalogue.load(kind, listing.name)
                except PluginError as error:
                    if error.code != "missing-extra":
                        failed.append(str(error))
    for package, failed in sorted(packages.items()):
        if package.partition(" ")[0] == DISTRIBUTION:
            continue
        if failed:
            remedy = _AGAIN.format(package.partition(" ")[0])
            yield InstallationFact(f"plugins of {package}", BROKEN, "; ".join(failed), remedy)
        else:
            yield InstallationFact(f"plugins of {package}", WORKS, "all can be imported")


def _worlds() -> Iterator[InstallationFact]:
    from symaware_cli.language import KINDS, Catalogue

    catalogue = Catalogue(KINDS)
    for name in sorted({listing.name for listing in catalogue.listings("environment")}):
        yield _tried(f"world {name}", "world", name)


def _tried(title: str, name: str, argument: str) -> InstallationFact:
    """Try something in a process of its own, without the current folder among its modules."""
    line = [sys.executable, "-P", "-m", "symaware_cli.cli.self_test", name, argument]
    try:
        done = subprocess.run(line, capture_output=True, text=True, timeout=_LONGEST, errors="replace", check=False)
    except subprocess.TimeoutExpired:
        return InstallationFact(title, BROKEN, f"no answer within {_LONGEST:g} s")
    if done.returncode == 0:
        status, message, remedy = json.loads(done.stdout.splitlines()[-1])
        return InstallationFact(title, status, message, remedy)
    how = f"signal {-done.returncode}" if done.returncode < 0 else f"status {done.returncode}"
    said = [text for text in done.stderr.splitlines() if text.strip()]
    remedy = _AGAIN.format(f"'symaware-cli[{MODULES[name][1]}]'") if name in MODULES else "install its package again"
    return InstallationFact(title, BROKEN, f"ended with {how}: {said[-1] if said else 'no output'}", remedy)
