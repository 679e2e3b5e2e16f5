"""What goes with what is plain from the verb: few options each, and those that exclude each other are refused."""

import re
import shlex
import sys
import tomllib
from pathlib import Path

import pytest
from checkout import CHECKOUT
from typer.testing import CliRunner

import symaware_cli
from symaware_cli.cli.application import all_commands, application
from symaware_cli.help_place import GROUPS, place_of

#: The greatest number of options of a verb, without --help and --results, which mean the same for all verbs.
#: The verbs named here show, run, and write kinds of plugins in many ways.
MOST, MANY = 12, ("run", "replay", "new plugin")

#: Pages on which former decisions are described, and the list of changes.
HISTORY = ("CHANGELOG.md",)


@pytest.mark.parametrize("verb", [verb for verb in all_commands() if verb not in MANY])
def test_a_verb_has_few_options(verb: str) -> None:
    found = [each for each in all_commands()[verb].params if each.param_type_name == "option"]
    options = [each.name for each in found if "--results" not in each.opts]
    assert len(options) <= MOST, options


@pytest.mark.parametrize("verb", MANY)
def test_the_help_of_a_verb_with_many_options_has_panels(verb: str) -> None:
    options = [each for each in all_commands()[verb].params if each.param_type_name == "option"]
    panels = [getattr(each, "rich_help_panel", None) for each in options]
    assert len(options) > MOST
    assert max(map(panels.count, panels)) < MOST
    assert panels.count(None) <= 3


def test_every_verb_is_in_one_of_the_groups_and_on_the_page_of_the_command_line() -> None:
    page = (CHECKOUT / "docs" / "commands.md").read_text(encoding="utf-8")
    sections = dict(zip(GROUPS, re.split(r"(?m)^\| (?:run|look|check|compare|author) \| \|$", page)[1:], strict=True))
    declared = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]["entry-points"]["symaware.commands"]
    all_commands()
    for verb, target in declared.items():
        module, _, name = target.partition(":")
        group = place_of(getattr(sys.modules[module], name)).group
        assert f"`symaware {verb} " in sections[group] or f"`symaware {verb}`" in sections[group], verb


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, a sweep and a scenario."""
    made = tmp_path_factory.mktemp("options")
    scenario = CHECKOUT / "scenarios" / "hello.yaml"
    (made / "hello.yaml").write_bytes(scenario.read_bytes())
    symaware_cli.load(scenario, ["run.duration=0.2"]).run(output=made / "hello.mcap")
    words = ["sweep", str(scenario), "-o", str(made / "swept"), "--set", "run.duration=0.2", "-q", "--jobs", "0"]
    assert CliRunner().invoke(application, words).exit_code == 0
    return made


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("run hello.mcap --index 1", "--index goes with the folder of a sweep, or with --seed"),
        ("run swept", "say which run of its sweep to repeat, with --index"),
        ("run swept --index 0 --seed 1", "--seed, --set and --plugin would make another run of it"),
        ("run swept --index 0 --set run.duration=1", "--seed, --set and --plugin would make another run of it"),
        ("run hello.yaml --no-record --output a.mcap", "--no-record writes no log, and --output names one"),
        ("run hello.yaml --listen 0 --join a:1", "--listen is for the host and --join for all others"),
        ("run hello.yaml --join a:1 --bind 0.0.0.0", "--bind says where a host listens"),
        ("run hello.yaml --only robot.0", "--only is for a run of several processes"),
        ("sweep swept", "`symaware resume swept` resumes its sweep"),
        ("sweep hello.yaml -o other --jobs 0 --on ray:auto", "leave one out"),
        ("resume swept --jobs 0 --on ray:auto", "leave one out"),
        ("resume hello.yaml", "`symaware sweep hello.yaml -o DIR` begins a sweep"),
        ("plan swept --runs 3", "swept says what to run"),
        ("rows swept --csv --json", "--csv and --json are two forms of the table"),
        ("rows hello.mcap", "is not the folder of a sweep"),
        ("shares hello.mcap", "is not the folder of a sweep"),
        ("compare hello.mcap closest", "is not the folder of a sweep"),
        ("log events swept", "swept is a folder"),
        ("replay hello.mcap --save a.rrd --web", "choose one of --save, --screenshot, --video, --web and --connect"),
        ("replay hello.mcap --follow --save a.rrd", "--follow shows a whole log in a viewer"),
        ("replay hello.mcap --at 0.1", "--at goes with --screenshot"),
        ("replay hello.mcap --size 300x300", "--size goes with --screenshot or --video"),
        ("replay hello.mcap --speed 2", "--speed goes with --video"),
        ("replay hello.mcap --view below", "--view is one of above, angle, front, side"),
        ("replay hello.mcap --port 9000", "--port is the port of --web"),
        ("replay hello.mcap --bind 0.0.0.0 --save a.rrd", "--bind goes with --web, or with a viewer of its own"),
        ("plot swept --series robot:state", "--series goes with a log"),
        ("plot swept --from 1", "--from goes with a log"),
        ("trajectories hello.mcap", "is not the folder of a sweep"),
        ("export hello.mcap --format foxglove --fields state", "--fields does not go with foxglove"),
        ("check hello.mcap --formula x --file a.yaml", "--formula and --file both say what to check"),
        ("check hello.mcap --formula x --each robot --pairs robot", "--each and --pairs both say"),
        ("check hello.mcap --each robot", "it goes with --formula"),
        ("verify hello.mcap --level all", "--level goes with a sweep"),
        ("verify hello.mcap --rows 3", "--rows goes with a sweep"),
        ("verify hello.mcap --key a.pem", "--key is for certificates"),
        ("verify swept --level all --rows 3", "--rows goes with the level sample, not with all"),
        ("verify swept --level monitor --seed 3", "--seed goes with the level sample, not with monitor"),
        ("diff hello.yaml hello.yaml --plot a.png", "--plot goes with two logs, or with two sweeps"),
        ("new scenario a --toml --like convoy", "--like scenarios are in YAML only: leave out --toml"),
        ("new plugin a", "say which kind of plugin to write, with one of --component risk|"),
        ("new plugin a --model --fault", "--model and --fault are different kinds of plugins: choose one"),
        ("new plugin a --component risk --model", "--component risk and --model are different kinds"),
        ("show unicycle --output a.svg", "--output goes with a scenario"),
    ],
)
def test_options_that_exclude_each_other_are_refused_in_a_sentence(
    line: str, sentence: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    done = CliRunner().invoke(application, shlex.split(line))
    assert done.exit_code == 2, done.output
    assert sentence in done.output
    assert len(done.output.splitlines()) <= 2 or "--json" in line
    assert sorted(folder.rglob("*")) == before


def test_no_document_has_options_that_no_verb_knows() -> None:
    """The documents and the text of the product name options that exist, of the verb that they name."""
    known = {verb: {text for each in command.params for text in each.opts} for verb, command in all_commands().items()}
    files = [*CHECKOUT.glob("*.md"), *CHECKOUT.glob("docs/**/*.md"), *CHECKOUT.glob("plugins/**/*.md")]
    files += [
        *CHECKOUT.glob("scenarios/**/*.yaml"),
        *CHECKOUT.glob("sweeps/*.yaml"),
        *CHECKOUT.glob("plugins/**/*.yaml"),
    ]
    files += CHECKOUT.glob("symaware_cli/**/*.py")
    wrong = []
    for file in files:
        if file.name in HISTORY:
            continue
        for found in re.finditer(
            r"symaware ((?:log |new (?=plugin|scenario))?[a-z]+)((?: [^\s`|;]+)*)", file.read_text(encoding="utf-8")
        ):
            verb, rest = found.groups()
            used = set(re.findall(r"(?<=\s)--[a-z][a-z-]*", rest)) - {"--help"}
            if verb in known and used - known[verb]:
                wrong.append(f"{file.relative_to(CHECKOUT)}: symaware {verb}{rest}")
    assert not wrong, wrong
