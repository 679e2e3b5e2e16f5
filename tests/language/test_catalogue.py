"""Plugins are found without being imported, and a broken one breaks only the scenario that uses it."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from symaware_cli.entry_points import PluginError
from symaware_cli.language.catalogue import Catalogue

PLUGINS = Path(__file__).parent / "plugins"

pytestmark = pytest.mark.usefixtures("known_plugins")


def refusal(kind: str, name: str) -> PluginError:
    with pytest.raises(PluginError) as raised:
        Catalogue().load(kind, name)
    return raised.value


def test_listing_imports_no_plugin() -> None:
    catalogue = Catalogue()
    names = [listing.name for kind in catalogue.kinds for listing in catalogue.listings(kind)]
    assert {"perception.self", "kinematic", "unicycle", "broken.exits", "sound.watch"} <= set(names)
    assert not any(name.startswith(("broken_plugins", "sound_plugins")) for name in sys.modules)


def test_listings_are_sorted_and_name_the_package_of_each_plugin() -> None:
    listings = Catalogue().listings("component")
    assert [listing.name for listing in listings] == sorted(listing.name for listing in listings)
    watch = next(listing for listing in listings if listing.name == "sound.watch")
    assert (watch.package, watch.version, watch.target) == ("sound-plugins", "2.1", "sound_plugins.components:Watch")
    assert not watch.built_in
    assert next(listing for listing in listings if listing.name == "perception.self").built_in


def test_a_sound_plugin_is_loaded_while_others_are_broken() -> None:
    assert Catalogue().load("component", "sound.watch").__name__ == "Watch"
    assert Catalogue().load("model", "sound.line").__name__ == "Line"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("import-error", "cannot be imported: ImportError: needs version 3 of something (import_error.py, line 3)"),
        (
            "missing-module",
            "cannot be imported: No module named 'a_module_that_nobody_has' (missing_module.py, line 3)",
        ),
        ("raises", "cannot be imported: OSError: no camera is connected (raises.py, line 5)"),
        ("exits", "cannot be imported: SystemExit: usage: exits.py FILE (exits.py, line 5)"),
        (
            "no-such-class",
            "cannot be imported: AttributeError: module 'broken_plugins.faulty' has no attribute 'Nobody'",
        ),
        ("function", "is not a subclass of Component or GroupComponent"),
        ("stranger", "is not a subclass of Component or GroupComponent"),
        ("abstract", "does not implement _update"),
        ("bad-parameters", "has Parameters that are not a subclass of symaware_cli.Parameters"),
    ],
)
def test_a_broken_plugin_is_reported_with_its_package_and_the_reason(name: str, message: str) -> None:
    error = refusal("component", f"broken.{name}")
    assert error.code == "broken-plugin"
    assert str(error) == f"the component `broken.{name}` of broken-plugins 1.0 {message}"


def test_a_syntax_error_is_reported_with_its_place() -> None:
    error = refusal("component", "broken.syntax-error")
    assert error.code == "broken-plugin"
    assert "SyntaxError: " in str(error)
    assert str(error).endswith("(syntax_error.py, line 1)")


def test_a_plugin_that_needs_an_extra_is_reported_with_the_command_to_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    error = refusal("component", "broken.missing-extra")
    assert error.code == "missing-extra"
    assert error.expected == "the extra `pybullet`: pip install 'symaware-cli[pybullet]'"


def test_a_name_that_two_packages_register_is_ambiguous() -> None:
    error = refusal("component", "twin.watch")
    assert error.code == "ambiguous-plugin"
    assert str(error) == "the component `twin.watch` is registered by twin-one and twin-two; uninstall one of them"
    assert len(Catalogue().find("twin.watch")) == 2


def test_a_plugin_of_another_kind_is_distinguished_from_a_missing_one() -> None:
    assert str(refusal("component", "unicycle")) == "`unicycle` is a model, not a component"
    assert str(refusal("model", "kinematic")) == "`kinematic` is an environment, not a model"


def test_an_unknown_name_gets_the_nearest_one_and_those_of_its_family() -> None:
    error = refusal("component", "sound.wacth")
    assert (error.suggestion, error.expected) == ("sound.watch", "a name that `symaware list components` shows")
    assert refusal("component", "sound.zzzzzzzzzzzz").expected == "one of sound.band, sound.plain, sound.watch"
    # More than a person reads, and none at all.
    assert refusal("component", "broken.quokka").expected == "a name that `symaware list components` shows"
    assert refusal("component", "nowhere").expected == "a name that `symaware list components` shows"


def test_the_plugins_are_found_in_a_process_of_its_own(
    process: Callable[..., subprocess.CompletedProcess[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(PLUGINS), os.environ.get("PYTHONPATH")])))
    listed = process("list", "components")
    assert listed.returncode == 0
    assert "broken.exits" in listed.stdout
    assert "broken-plugins 1.0" in listed.stdout
    shown = process("show", "broken.exits")
    assert shown.returncode == 2
    assert "cannot be imported: SystemExit" in shown.stderr
    assert process("show", "perception.self").returncode == 0
    schema = process("schema")
    assert schema.returncode == 0
    assert schema.stderr.count("symaware: left out: ") >= 10
    assert '"sound.watch"' in schema.stdout
