"""Any change in the folder of a certified sweep is detected, or listed here as carrying no claim."""

import contextlib
import io
import json
import re
import runpy
import shutil
import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import pyarrow
import pytest
import yaml
from altered_logs import altered
from checkout import CHECKOUT
from forging import SCENARIO, SWEEP
from pyarrow import parquet
from sweeping import symaware

import symaware_cli as sa
from symaware_cli.evidence.certificate_check import certificate_findings, opened
from symaware_cli.log.wire import encode_rows
from symaware_cli.studies.folder import SweepFolder

CHECK = CHECKOUT / "docs" / "check_certificate.py"

#: Items that the script of the standard library does not read, as listed in its docstring.
UNREAD_BY_SCRIPT = {
    "certificate.json: predicate.probability_over",
    "certificate.json: predicate.method",
    "certificate.json: predicate.rows.hash",
    "certificate.json: predicate.formula.semantics",
    "certificate.json: predicate.formula.symaware",
    "journal.sqlite: seed_key",
    "journal.sqlite: trace",
    "journal.sqlite: log",
    "journal.sqlite: wall_time",
}
#: Items that carry no claim, so that `verify` does not read them either: wall times, and the sweep as written.
WITHOUT_CLAIM = {
    "journal.sqlite: seed_key",
    "journal.sqlite: trace",
    "journal.sqlite: wall_time",
}
#: Files that carry no claim.
FILES_WITHOUT_CLAIM = ["as-written.yaml", "times.parquet"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("evidence")
    (folder / "passing.yaml").write_text(SCENARIO)
    (folder / "sweep.yaml").write_text(SWEEP + "seed: 4\n")
    symaware("sweep", folder / "sweep.yaml", "-o", folder / "out", "--jobs", 0, "--quiet")
    assert sa.certify(folder / "out").is_established
    return folder / "out"


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return shutil.copytree(made, tmp_path / "out")


def script(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, bool]:
    """Return the output of the script, and whether the certificate follows."""
    monkeypatch.setattr("sys.argv", [str(CHECK), str(folder)])
    with contextlib.redirect_stdout(io.StringIO()) as said, pytest.raises(SystemExit) as ended:
        runpy.run_path(str(CHECK), run_name="__main__")
    return said.getvalue(), ended.value.code == 0


def verified(folder: Path) -> bool:
    return sa.verify_sweep(folder, "arithmetic").is_sound


def leaves(tree: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Yield the paths of all values; of the many versions, only the first and that of NumPy."""
    if isinstance(tree, Mapping):
        names = [each for each in tree if place[-1:] != ("versions",) or each in ("Python", "numpy")]
        for name in names:
            yield from leaves(tree[name], (*place, name))
    elif isinstance(tree, list):
        for number, each in enumerate(tree):
            yield from leaves(each, (*place, number))
    else:
        yield place


def changed(tree: Any, place: tuple[str | int, ...]) -> Any:
    """Return a copy with a different value at a path."""
    copied = json.loads(json.dumps(tree))
    part = copied
    for name in place[:-1]:
        part = part[name]
    part[place[-1]] = other(part[place[-1]])
    return copied


def other(value: Any) -> Any:
    """Return a different value of the same type."""
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return value * 1.5 if value else 0.5
        case str() if re.fullmatch("[0-9a-f]{64}", value):
            return value[::-1]
        case str() if "0.1" in value:  # a claim, with another probability
            return value.replace("0.1", "0.9")
        case str():
            return f"{value}x"
    return "another"


def named(place: tuple[str | int, ...]) -> str:
    return "".join(f"[{each}]" if isinstance(each, int) else f".{each}" for each in place).lstrip(".")


def test_an_unchanged_folder_is_sound_and_the_script_prints_the_claim(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said, follows = script(folder, monkeypatch)
    assert follows
    assert said.startswith("the claim: P(near) > 0.1 with confidence 0.6, fixed; stated before the first run\n")
    assert verified(folder)


def test_changes_to_each_field_of_the_certificate_are_detected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = folder / "certificate.json"
    content = json.loads(file.read_text())
    sweep = SweepFolder.opened(folder)
    unread = set()
    for place in leaves(content):
        file.write_text(json.dumps(changed(content, place)))
        name = f"certificate.json: {named(place)}"
        said, follows = script(folder, monkeypatch)
        if follows:
            unread.add(name)
        else:
            assert "not as certified" in said
        try:
            assert (name, bool(list(certificate_findings(sweep, file, opened(file))))) == (name, True)
        except sa.LogError:
            assert place == ("_type",)
    assert unread == {each for each in UNREAD_BY_SCRIPT if each.startswith("certificate.json")}


@pytest.mark.slow
def test_changes_to_each_field_of_the_identity_are_detected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = folder / "identity.json"
    content = json.loads(file.read_text())
    places = [place for place in leaves(content) if "resolved" not in place or len(place) < 4]
    for place in places:
        file.write_text(json.dumps(changed(content, place), indent=1) + "\n")
        assert (named(place), script(folder, monkeypatch)[1]) == (named(place), False)
        assert (named(place), verified(folder)) == (named(place), False)


@pytest.mark.slow
def test_changes_to_each_value_of_the_scenario_are_detected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = folder / "scenario" / "passing.yaml"
    content = yaml.safe_load(file.read_text())
    for place in leaves(content):
        if place in (("symaware",), ("environment", "use")) or place[-1] == "use":
            continue  # no other value is valid
        file.write_text(yaml.safe_dump(changed(content, place), sort_keys=False))
        assert (named(place), script(folder, monkeypatch)[1]) == (named(place), False)
        try:
            assert (named(place), verified(folder)) == (named(place), False)
        except sa.ScenarioError:
            continue  # rejected as well


def test_changes_to_each_value_of_the_plan_are_detected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = folder / "sweep.yaml"
    content = yaml.safe_load(file.read_text())
    for place in leaves(content):
        file.write_text(yaml.safe_dump(changed(content, place), sort_keys=False))
        assert (named(place), script(folder, monkeypatch)[1]) == (named(place), False)
        try:
            assert (named(place), verified(folder)) == (named(place), False)
        except sa.ScenarioError:
            continue


COLUMNS: Mapping[str, Callable[[Any], Any]] = {
    "identity": lambda value: value[::-1],
    "parameters": lambda value: value.replace("0.8", "0.7"),
    "variant": lambda value: "another",
    "seed_key": lambda value: value + 1,
    "seed": lambda value: value + 1,
    "state": lambda value: "failed",
    "verdicts": lambda value: value.replace("satisfied", "violated", 1),
    "robustness": lambda value: re.sub(r"\d\.", "9.", value, count=1),
    "metrics": lambda value: re.sub(r"\d\.", "9.", value, count=1),
    "digest": lambda value: value[::-1],
    "error": lambda value: "a fault",
    "trace": lambda value: "a trace",
    "log": lambda value: value.replace(value[0], "f" if value[0] != "f" else "e"),
    "wall_time": lambda value: value + 1.0,
}


def test_changes_to_each_column_of_the_journal_are_detected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = folder / "journal.sqlite"
    with closing(sqlite3.connect(file)) as journal:
        names = [row[1] for row in journal.execute("PRAGMA table_info(runs)")]
        row = dict(zip(names, journal.execute('SELECT * FROM runs WHERE "index" = 1').fetchone(), strict=True))
    assert {*names} == {"index", *COLUMNS}
    unread, sound = set(), set()
    for name, change in COLUMNS.items():
        for value in (change(row[name]), row[name]):
            with closing(sqlite3.connect(file)) as journal, journal:
                journal.execute(f'UPDATE runs SET "{name}" = ? WHERE "index" = 1', (value,))
            if value != row[name]:
                unread |= {f"journal.sqlite: {name}"} if script(folder, monkeypatch)[1] else set()
                sound |= {f"journal.sqlite: {name}"} if verified(folder) else set()
    assert unread == {each for each in UNREAD_BY_SCRIPT if each.startswith("journal")}
    assert sound == WITHOUT_CLAIM


@pytest.mark.slow
def test_changes_to_each_column_of_the_table_are_detected(folder: Path) -> None:
    file = folder / "runs.parquet"
    table = parquet.read_table(file)
    for place, name in enumerate(table.column_names):
        values = table.column(name).to_pylist()
        values[1] = _another(values[1], table.schema.field(name).type)
        if values[1] is None:
            continue
        column = pyarrow.array(values, table.schema.field(name).type)
        parquet.write_table(table.set_column(place, table.schema.field(name), column), file)
        assert (name, verified(folder)) == (name, False)


def _another(value: Any, kind: pyarrow.DataType) -> Any:
    """Return a different value for a column; None for lists, which are compared like other values."""
    if pyarrow.types.is_list(kind):
        return value[::-1] if isinstance(value, list) and len(value) > 1 else None
    if pyarrow.types.is_dictionary(kind) or pyarrow.types.is_string(kind):
        return "another"
    if pyarrow.types.is_boolean(kind):
        return not value
    return (value or 0) + 1


def test_changes_to_the_page_and_the_row_hashes_are_detected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page, hashes = folder / "certificate.html", folder / "certificate.leaves"
    for file, old, new in ((page, "&gt; 0.1", "&gt; 0.99"), (hashes, "\n1 ", "\n1 0")):
        text = file.read_text()
        assert old in text
        file.write_text(text.replace(old, new))
        assert (file.name, verified(folder)) == (file.name, False)
        assert script(folder, monkeypatch)[1] == (file is page)
        file.write_text(text)
    assert verified(folder)


@pytest.mark.parametrize(
    ("kind", "level"),
    # The outcome of the run and the metadata of channels are not part of a digest; repetition detects their changes.
    [("message", "arithmetic"), ("attachment", "arithmetic"), ("outcome", "all"), ("metadata", "all")],
)
def test_changes_to_a_kept_log_are_detected(kind: str, level: Any, folder: Path) -> None:
    log = sorted((folder / "logs").iterdir())[0]
    changes: dict[str, Any] = {
        "message": lambda message: (
            encode_rows(message.decode().values + 1, message.decode().rows)
            if message.channel.topic == "/world/robot/state"
            else message.data
        ),
        "attachment": lambda name, data: data.replace(b"speed: ", b"speed: 1") if name.endswith(".yaml") else data,
        "outcome": lambda content: {**content, "steps": content["steps"] + 1},
        "metadata": lambda topic, content: {**content, "unit": "ft"},
    }
    forged = folder / "forged.mcap"
    altered(log, forged, **{kind: changes[kind]})
    forged.replace(log)
    assert not sa.verify_sweep(folder, level).is_sound


@pytest.mark.parametrize("level", ["arithmetic", "monitor", "sample", "all"])
@pytest.mark.parametrize("what", ["scenario", "certificate", "another certificate"])
def test_every_level_detects_a_contradicting_digest(what: str, level: Any, folder: Path) -> None:
    if what == "scenario":
        file, old, new = folder / "scenario" / "passing.yaml", "position[1] < 9", "position[1] < 8"
    else:
        file, old, new = folder / "certificate.json", '"probability": 0.1', '"probability": 0.2'
    if what == "another certificate":
        file = folder / "signed.json"
        shutil.copy(folder / "certificate.json", file)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    result = sa.verify_sweep(folder, level)
    assert not result.is_sound
    wanted = "scenario of combination 0" if what == "scenario" else f"{file.name}, predicate.claim.probability"
    assert wanted in [each.column for each in result.findings]


def test_every_file_is_verified_or_listed_as_carrying_no_claim(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in FILES_WITHOUT_CLAIM:
        (folder / name).write_bytes(b"")
    assert verified(folder)
    assert script(folder, monkeypatch)[1]
    read = {"certificate", "identity", "journal", "runs", "sweep", "logs", "scenario"}  # by the tests above
    names = {each.name for each in folder.iterdir() if each.name not in FILES_WITHOUT_CLAIM}
    assert {name.partition(".")[0] for name in names if not name.startswith(".")} == read


def test_a_destroyed_certificate_is_a_finding(folder: Path) -> None:
    (folder / "certificate.json").write_text("{")
    (folder / "notes.json").write_text("{}")
    assert [each.column for each in sa.verify_sweep(folder, "arithmetic").findings] == ["certificate.json"]


def test_a_damaged_certificate_can_be_replaced_by_certifying_again(folder: Path) -> None:
    (folder / "certificate.json").write_text("{")
    assert sa.certify(folder).is_established
    assert verified(folder)
