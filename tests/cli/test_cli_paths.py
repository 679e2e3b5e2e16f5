"""Every path that a verb takes may be one that cannot be used: it says so in a sentence, and loses nothing."""

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from inspect import signature
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from typer.main import get_command
from typer.models import OptionInfo

from symaware_cli.cli import open_streams
from symaware_cli.cli.application import all_commands, application

CALLBACKS: Mapping[str, Callable[..., Any]] = {
    name: each.callback for name, each in all_commands().items() if each.callback is not None
}

SCENARIO = """\
symaware: 1
name: room
run: {duration: 0.2}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  robot:
    model: {use: unicycle, with: {max_speed: 1, process_noise: 0.1}}
    state: [0, 0, 0]
    knowledge: {goal: [3, 0]}
    components: {steer: {use: control.go-to-goal}}
regions: {room: {box: [0, 4, 0, 4]}}
knowledge_models: {grid: {use: abstraction.grid, with: {cell: 2.0, region: room}}}
specifications: {safe: {each: robot, formula: "always x < 5"}}
"""

FILES: Mapping[str, str] = {
    **dict.fromkeys(["scenario"], "room.yaml"),
    **dict.fromkeys(["log", "one", "other", "against"], "log.mcap"),
    **dict.fromkeys(["folder", "folders"], "sweep"),
    "key": "key.pem",
    "key_file": "secret",
    "plugins": "mine.py",
    "file": "specifications.yaml",
    "scenarios": "room.yaml",
    "tolerance": "tolerance.yaml",
    "case": "case.yaml",
}
"""The sound file for a parameter, by its name; that of others is given by the call."""

CALLS: Mapping[str, Sequence[Sequence[str]]] = {
    "run": [[], ["--listen", "0", "--wait", "0.1", "key_file=secret"]],
    "sweep": [["target=room.yaml", "--jobs", "0"]],
    "resume": [["--jobs", "0"]],
    "plan": [["target=room.yaml"], ["target=sweep"]],
    "validate": [[]],
    "doctor": [["--quick"]],
    "new scenario": [["name=room"]],
    "new plugin": [["name=room", "--metric"]],
    "replay": [["path=log.mcap", "save=replay.rrd"]],
    "plot": [["path=log.mcap", "--dpi", "20"], ["path=sweep", "--dpi", "20"]],
    "export": [["path=log.mcap", "--format", "csv"], ["path=log.mcap", "--format", "foxglove"]],
    "trajectories": [["--dpi", "20"]],
    "inspect": [["path=log.mcap"], ["path=sweep"]],
    "log events": [["path=log.mcap"]],
    "log messages": [["path=log.mcap"]],
    "log contacts": [["path=log.mcap"]],
    "log series": [["path=log.mcap", "robot:state"]],
    "log digest": [["path=log.mcap"]],
    "rows": [[]],
    "shares": [[]],
    "compare": [["index"]],
    "check": [["paths=log.mcap"], ["paths=log.mcap", "--formula", "always x < 4"], ["paths=sweep"]],
    "verify": [["path=log.mcap"], ["path=sweep"], ["path=sweep/certificate.json"]],
    "certify": [[]],
    "assure": [["output=assured"]],
    "budget": [["output=budget", "--claim", "P(safe) > 0.1 with confidence 0.5", "--over", "run.duration=0.1"]],
    "falsify": [["--specification", "safe", "--seeds", "2", "--runs", "2", "--jobs", "0"]],
    "estimate": [["--specification", "safe", "--levels", "none", "--trials", "1", "--repeats", "2", "--jobs", "0"]],
    "explain": [
        ["log=violated.mcap", "--before", "0.5", "--within", "0.1", "--futures", "16", "--agents", "runner"],
    ],
    "diff": [[], ["one=room.yaml", "other=room.yaml"], ["one=sweep", "other=sweep"]],
    "report": [["path=log.mcap"], ["path=sweep"]],
    "branch": [["--at", "0.1"], ["--at", "0.1", "--over", "agents.robot.knowledge.goal=[3, 1]"]],
    "recover": [["path=log.mcap"]],
    "merge": [["paths=log.mcap", "output=merged.mcap"]],
    "list": [[]],
    "show": [["name=room.yaml"]],
    "schema": [[]],
    "trust": [[]],
}
"""Calls of each verb that work, without the paths of `FILES`. A new verb needs an entry."""

WRITTEN = ("output", "save", "screenshot", "video", "pdf", "plot")
"""The parameters that name something to write."""

SUFFIXES = {
    "run": ".mcap",
    "replay0-save": ".rrd",
    "replay0-video": ".gif",
    "replay": ".png",
    "plot": ".png",
    "trajectories": ".png",
    "diff": ".png",
    "explain": ".png",
    "export1": ".mcap",
    "certify": ".json",
    "report0-pdf": ".pdf",
    "report1-pdf": ".pdf",
    "report": ".html",
    "branch0": ".mcap",
    "recover": ".mcap",
    "merge": ".mcap",
    "show": ".svg",
    "schema": ".json",
}
"""The suffixes of what is written, by the beginning of a case's name; what is not here is a folder."""

WITHOUT_PATHS: tuple[str, ...] = ("doctor",)


def paths_of(verb: str) -> Mapping[str, str | None]:
    """The parameters of a verb that are paths, with their option; None for arguments."""
    callback, found = CALLBACKS[verb], {}
    hints = get_type_hints(callback, include_extras=True)
    for name in signature(callback).parameters:
        if "Path" not in str(get_type_hints(callback)[name]) and name != "name":
            continue
        info = hints[name].__metadata__[0]
        is_option = isinstance(info, OptionInfo)
        if name == "name" and is_option:
            continue
        # Within `Annotated`, the first name of an option is in the place of its default.
        names = (str(info.default), *(info.param_decls or ()))
        declared = [text for text in names if text.startswith("--")] if is_option else []
        found[name] = (declared or [f"--{name.replace('_', '-')}"])[0] if is_option else None
    return found


QUICKLY = ("in a folder without rights", "a name of 305 characters", "a name that is not UTF-8")
"""The reasons that are tried in the first stage; there, verbs that draw are left out."""

CASES = [
    pytest.param(verb, number, name, id=f"{verb}{number or ''}-{name}")
    for verb in CALLS
    for number, _ in enumerate(CALLS[verb])
    for name in paths_of(verb)
]

FIRST = [
    (verb, name)
    for verb in CALLS
    if verb not in ("plot", "trajectories", "replay", "report", "show")
    for name in paths_of(verb)
]


def test_every_verb_has_its_calls() -> None:
    assert CALLS.keys() == CALLBACKS.keys()
    assert {verb for verb in CALLBACKS if not paths_of(verb)} == set(WITHOUT_PATHS)


def called(arguments: Sequence[str]) -> tuple[int, str]:
    """Run the command in this process, with streams that encode as those of a terminal do."""
    streams = [io.TextIOWrapper(io.BytesIO(), "utf-8", errors=how) for how in ("strict", "backslashreplace")]
    with redirect_stdout(streams[0]), redirect_stderr(streams[1]):
        open_streams()
        try:
            get_command(application).main(arguments)
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
        for stream in streams:
            stream.flush()
    said = [stream.buffer.getvalue() for stream in streams]
    return status, b"".join(said).decode(errors="backslashreplace")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with sound files."""
    folder = tmp_path_factory.mktemp("sound")
    (folder / "room.yaml").write_text(SCENARIO)
    (folder / "secret").write_text("0" * 64)
    (folder / "mine.py").write_text("")
    (folder / "case.yaml").write_text(
        "symaware-case: 1\nname: room\ngoals: {G1: {text: Safe, by: [Sn1]}}\n"
        "solutions: {Sn1: {log: log.mcap, specification: safe}}\n"
    )
    (folder / "tolerance.yaml").write_text("symaware-tolerance: 1\nchannels: {/contacts: {ignore: true}}\n")
    (folder / "specifications.yaml").write_text("near: {each: robot, formula: 'always x < 4'}\n")
    key = Ed25519PrivateKey.generate()
    form = serialization.PrivateFormat.PKCS8
    pem = key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption())
    (folder / "key.pem").write_bytes(pem)
    quiet, at = ["--quiet", "--set"], str(folder / "room.yaml")
    assert called(["run", at, *quiet, "seed=1", "--output", str(folder / "log.mcap")]) == (0, "")
    mist = str(Path(__file__).parents[2] / "scenarios" / "mist.yaml")
    violated = [mist, *quiet, "run.duration=4.0", "--output", str(folder / "violated.mcap")]
    assert called(["run", *violated])[0] in (0, 3)
    claim = [
        "--with",
        "claim=P(safe) > 0.1 with confidence 0.5, fixed",
        "--with",
        "keep=all",
        "--runs",
        "2",
        "--jobs",
        "0",
    ]
    assert called(["sweep", at, *claim, "--jobs", "0", *quiet, "seed=1", "--output", str(folder / "sweep")]) == (0, "")
    assert called(["certify", str(folder / "sweep"), "--key", str(folder / "key.pem")])[0] in (0, 3)
    return folder


def line(verb: str, number: int, changed: str, value: str, sound: Path) -> list[str]:
    """A command line that works, except for one path."""
    words, options = verb.split(), []
    for name, option in paths_of(verb).items():
        path = value if name == changed else sound_path(verb, number, name, sound)
        if path is not None:
            words += [path] if option is None else []
            options += [] if option is None else [option, path]
    return [*words, *options, *(word for word in CALLS[verb][number] if not is_path(verb, word))]


def is_path(verb: str, word: str) -> bool:
    return word.partition("=")[0] in paths_of(verb)


def sound_path(verb: str, number: int, name: str, sound: Path) -> str | None:
    """The path that a call has for a parameter; None if it leaves the parameter out."""
    given = dict(word.split("=", 1) for word in CALLS[verb][number] if is_path(verb, word))
    if name in given:
        return given[name] if name in WRITTEN or name == "name" else str(sound / given[name])
    is_needed = signature(CALLBACKS[verb]).parameters[name].default is not None
    return str(sound / FILES[name]) if is_needed else None


def suffix_of(verb: str, number: int, name: str, sound: Path) -> str:
    """The suffix that the path for a parameter has to have."""
    if name in WRITTEN:
        return next((suffix for key, suffix in SUFFIXES.items() if f"{verb}{number}-{name}".startswith(key)), "")
    return Path(sound_path(verb, number, name, sound) or FILES[name]).suffix


def content(folder: Path) -> Mapping[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder that becomes the present one; whatever is closed in it is opened at the end."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for path in (tmp_path / "closed", tmp_path / "kept"):
        if path.exists():
            path.chmod(0o700)


def unusable(good: Path | None, here: Path, suffix: str) -> Iterator[tuple[str, str]]:
    """Paths that cannot be used, each with the reason; in the place of one that can be read, or of one to write."""
    closed, kept, file = here / "closed", here / "kept", here / "file"
    file.write_text("a file")
    closed.mkdir()
    kept.mkdir()
    (here / f"folder{suffix}").mkdir()
    (here / f"folder{suffix}" / "something").touch()
    if good is not None:
        (closed / f"it{suffix}").symlink_to(good)
        shut = here / f"shut{suffix}"
        shut.write_bytes(good.read_bytes()) if good.is_file() else shut.mkdir()
        shut.chmod(0)
        yield str(shut), "without rights"
    else:
        kept.chmod(0o500)
        yield str(kept / f"it{suffix}"), "in a folder that may not be written"
        yield str(kept / "deep" / f"it{suffix}"), "in a new folder in one that may not be written"
    closed.chmod(0)
    yield str(closed / f"it{suffix}"), "in a folder without rights"
    yield f"{'a' * 300}{suffix or '.long'}", "a name of 305 characters"
    yield f"{'b' * 300}/it{suffix}", "in a folder with such a name"
    yield "/".join(["c" * 200] * 30) + suffix, "a path that is too long"
    yield str(file / f"it{suffix}"), "in a file"
    if suffix:
        yield str(here / f"folder{suffix}"), "a folder in the place of a file"
    elif good is None:
        yield str(file), "a file in the place of a folder"
    strange = here / f"caf\udce9{suffix}"
    if good is not None:
        strange.symlink_to(good)
    yield str(strange), "a name that is not UTF-8"


def refused(verb: str, number: int, name: str, sound: Path, here: Path, reasons: Sequence[str] = ()) -> None:
    """Give a verb paths that cannot be used, those for some reasons or all."""
    before = content(sound)
    good = None if name in WRITTEN else Path(sound_path(verb, number, name, sound) or sound / FILES[name])
    for path, why in unusable(good, here, suffix_of(verb, number, name, sound)):
        if reasons and why not in reasons:
            continue
        arguments = line(verb, number, name, path, sound)
        status, said = called(arguments)
        assert (status, "Traceback" in said) in ((1, False), (2, False)), (why, arguments, said)
        assert 0 < len(said.splitlines()) < 8, (why, said)
        assert content(sound) == before, why


@pytest.mark.usefixtures("ordinary_rights")
@pytest.mark.parametrize(("verb", "name"), FIRST)
def test_an_unusable_path_is_reported(verb: str, name: str, sound: Path, here: Path) -> None:
    refused(verb, 0, name, sound, here, QUICKLY)


READ = [(verb, name) for verb in CALLS if not verb.startswith("new ") for name in paths_of(verb) if name not in WRITTEN]
"""Every parameter of a verb that names something to read."""

FITTING: Mapping[tuple[str, str], tuple[int, Sequence[str]]] = {
    ("run", "key_file"): (1, ()),
    ("sweep", "target"): (0, ("--output", "swept")),
    ("verify", "key"): (2, ()),
}
"""The call of a verb in which a parameter has a meaning, and the options that it needs, where it is not the first."""


TAKE_FOLDERS = {
    *((verb, "folder") for verb in CALLS),
    ("check", "paths"),
    ("trust", "folder"),
    ("report", "path"),
}
"""Parameters that an empty folder fits, or fails for another reason."""


@pytest.mark.parametrize(("verb", "name"), READ)
def test_a_missing_or_a_broken_file_has_the_same_status_with_every_verb_and_is_named(
    verb: str, name: str, sound: Path, here: Path
) -> None:
    number, more = FITTING.get((verb, name), (0, ()))
    suffix = suffix_of(verb, number, name, sound)
    broken = here / f"broken{suffix}"
    broken.write_bytes(b"\x00{[: nothing that a program can read\xff")
    (here / "room.yaml").write_text(SCENARIO)
    text, folder = here / f"text{suffix}", here / f"folder{suffix}"
    text.write_text("Dear reader: this is no such file.\n" * 40)
    folder.mkdir()
    # Any bytes are a secret key; folders are searched for logs, tried as sweeps, trusted, or described as an index.
    wrong = [here / f"missing{suffix}", *([broken, text] * (name != "key_file"))]
    wrong += [folder] * ((verb, name) not in TAKE_FOLDERS)
    for path in wrong:
        status, said = called([*line(verb, number, name, str(path), sound), *more])
        # Without the frame around errors of options, within which long paths are broken.
        assert (status, path.name in re.sub(r"[\s│]", "", said)) == (2, True), (path.name, said)


@pytest.mark.slow
@pytest.mark.usefixtures("ordinary_rights")
@pytest.mark.parametrize(("verb", "number", "name"), CASES)
def test_every_unusable_path_is_reported(verb: str, number: int, name: str, sound: Path, here: Path) -> None:
    refused(verb, number, name, sound, here)
