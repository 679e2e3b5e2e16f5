"""Entry points that lead nowhere are named, with the package and a correction."""

from collections.abc import Callable
from pathlib import Path

import pytest

from symaware_cli.testing import ConformanceError, check_entry_points

Install = Callable[..., str]

MODULE = '''
from symaware_cli import Controller, TimeSeries
class Still(Controller):
    """Does not move."""
    def _compute(self):
        return [0.0, 0.0], TimeSeries()
class Unfinished(Controller):
    """Does nothing."""
def verb():
    """Print nothing."""
number = 3
'''


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install a package with entry points by group; its modules are `sound_plugins` and `broken_import`."""

    def installed(name: str, **groups: dict[str, str]) -> str:
        information = tmp_path / f"{name.replace('-', '_')}-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = [
            line
            for group, points in groups.items()
            for line in (f"[symaware.{group}]", *(f"{key} = {target}" for key, target in points.items()))
        ]
        (information / "entry_points.txt").write_text("\n".join(lines))
        (tmp_path / "sound_plugins.py").write_text(MODULE)
        (tmp_path / "broken_import.py").write_text("import a_module_that_is_not_there\n")
        monkeypatch.syspath_prepend(tmp_path)
        return name

    return installed


def said_of(name: str) -> list[str]:
    with pytest.raises(ConformanceError) as caught:
        check_entry_points(name)
    return list(caught.value.deviations)


def test_a_package_whose_entry_points_are_of_their_kinds_conforms(install: Install) -> None:
    check_entry_points(
        install(
            "sound-package", components={"sound.still": "sound_plugins:Still"}, commands={"verb": "sound_plugins:verb"}
        )
    )


def test_an_import_error_is_reported_once_for_all_entry_points_of_a_module(install: Install) -> None:
    points = {f"broken.{letter}": f"broken_import:{letter.upper()}" for letter in "abc"}
    (said,) = said_of(install("broken-package", components=points, models={"broken.d": "broken_import:D"}))
    assert "the component `broken.a` of broken-package 1.0 cannot be imported" in said
    assert "No module named 'a_module_that_is_not_there' (broken_import.py, line 1)" in said
    assert "python -c 'import broken_import'" in said


@pytest.mark.parametrize(
    ("group", "key", "target", "words"),
    [
        ("components", "odd.nowhere", "sound_plugins:Nowhere", "`odd.nowhere` of odd-package 1.0 cannot be imported"),
        ("models", "odd.still", "sound_plugins:Still", "(sound_plugins:Still) is not a subclass of Model; register it"),
        ("components", "odd.unfinished", "sound_plugins:Unfinished", "does not implement _compute"),
        ("components", "control.mpc", "sound_plugins:Still", "has the name of a built-in one and is never used"),
        ("component", "odd.still", "sound_plugins:Still", "did you mean `symaware.components`?"),
        ("commands", "odd", "sound_plugins:number", "is not callable"),
        ("subscribers", "odd.still", "sound_plugins:Still", "is not a function of an event"),
        ("drawings", "odd.still", "sound_plugins:Still", "is not a subclass of Drawing"),
        ("transports", "odd.still", "sound_plugins:Still", "is not a subclass of Transport"),
    ],
)
def test_an_entry_point_that_cannot_be_used_is_named(
    install: Install, group: str, key: str, target: str, words: str
) -> None:
    (said,) = said_of(install("odd-package", **{group: {key: target}}))
    assert words in said
    assert key in said


def test_a_package_without_entry_points_is_reported(install: Install) -> None:
    (said,) = said_of(install("plain-package"))
    assert "plain-package has no entry points in groups like symaware.components" in said


def test_a_package_that_is_not_installed_is_reported() -> None:
    (said,) = said_of("symaware-nowhere")
    assert "symaware-nowhere is not installed here" in said
