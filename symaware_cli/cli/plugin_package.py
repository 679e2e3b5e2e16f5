"""The packages that ``symaware new plugin`` writes, from the templates in the folder ``scaffold``.

Reasons: docs/decisions/0077-scaffolds.md
"""

from __future__ import annotations

import keyword
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from string import Template

_TEMPLATES = Path(__file__).with_name("scaffold")

#: The packages that the templates import, besides this one, with the distributions that a new package then requires.
_REQUIRED = ("numpy", "pydantic", "typer")


class ScaffoldError(Exception):
    """A package cannot be written; the message is a sentence for its author."""


@dataclass(frozen=True, slots=True)
class PluginScaffold:
    """A kind of plugin that ``symaware new plugin`` writes; its templates are in the folder of this name.

    In the texts, ``$name`` is the name of the package and ``$module`` that of its module.

    Attributes:
        folder: The folder of its templates.
        option: The option that chooses it.
        module: The module of the plugin within the package.
        summary: The description of the package.
        points: The plugins by their entry points, for each entry-point group.
        commands: Lines of commands for the README, besides the installation, the test and a run.
        extra: The extra of this package that is required.
    """

    folder: str
    option: str
    module: str
    summary: str
    points: Mapping[str, Mapping[str, str]]
    commands: Sequence[str] = ()
    extra: str = ""


def _component(
    purpose: str, module: str, summary: str, points: Mapping[str, str], commands: Sequence[str]
) -> PluginScaffold:
    return PluginScaffold(purpose, f"--component {purpose}", module, summary, {"symaware.components": points}, commands)


def _kind(
    flag: str,
    group: str,
    module: str,
    summary: str,
    points: Mapping[str, str],
    commands: Sequence[str] = (),
    extra: str = "",
) -> PluginScaffold:
    return PluginScaffold(flag, f"--{flag}", module, summary, {group: points}, commands, extra)


#: All kinds. Those of components are chosen by their purpose, all others by a flag that is the name of the folder.
SCAFFOLDS: Sequence[PluginScaffold] = (
    _component(
        "risk",
        "closeness",
        "A risk that rises as others come closer",
        {"$name.closeness": "Closeness"},
        [
            "symaware show $name.closeness",
            "symaware log series $name.mcap robot.0:risk --every 1",
        ],
    ),
    _component(
        "controller",
        "orbit",
        "A controller that circles a point",
        {"$name.orbit": "Orbit"},
        [
            "symaware show $name.orbit",
            "symaware plot $name.mcap",
        ],
    ),
    _component(
        "perception",
        "coarse",
        "A perception that sees others nearby, at coarse positions",
        {"$name.coarse": "Coarse"},
        [
            "symaware show $name.coarse",
            "symaware replay $name.mcap",
        ],
    ),
    _component(
        "uncertainty",
        "dead_reckoning",
        "An uncertainty that grows with the distance travelled",
        {"$name.dead-reckoning": "DeadReckoning"},
        [
            "symaware show $name.dead-reckoning",
            "symaware replay $name.mcap",
        ],
    ),
    _component(
        "communication",
        "greeting",
        "Agents that tell each other where they are going",
        {"$name.tell": "TellGoal", "$name.hear": "HearGoals"},
        [
            "symaware show $name.tell",
            "symaware log messages $name.mcap --limit 10",
        ],
    ),
    _kind(
        "model",
        "symaware.models",
        "sled",
        "A sled with drag, which is moved by forces",
        {"$name.sled": "Sled"},
        [
            "symaware show $name.sled",
            "symaware plot $name.mcap",
        ],
    ),
    _kind(
        "environment",
        "symaware.environments",
        "windy",
        "A world with a wind",
        {"$name.windy": "Windy"},
        [
            "symaware show $name.windy",
            "symaware plot $name.mcap",
        ],
    ),
    _kind(
        "topology",
        "symaware.topologies",
        "relay",
        "A topology with a relay that drives from agent to agent",
        {"$name.relay": "Relay"},
        [
            "symaware show $name.relay",
            "symaware log messages $name.mcap --limit 10",
        ],
    ),
    _kind(
        "transport",
        "symaware.transports",
        "announced",
        "A transport that writes the address of the host to a file",
        {"$name.announced": "Announced"},
        [
            "symaware show $name.announced",
            "symaware run scenarios/$name.yaml --listen 0 --only robot.0 &",
            "symaware run scenarios/$name.yaml --join $$(cat address.txt) --only robot.1",
        ],
    ),
    _kind(
        "fault",
        "symaware.faults",
        "swing",
        "A fault: a sensor whose measurements swing",
        {"$name-swing": "Swing"},
        [
            "symaware show $name-swing",
            "symaware log events $name.mcap",
        ],
    ),
    _kind(
        "metric",
        "symaware.metrics",
        "detour",
        "A metric of sweeps: how much farther agents go than straight ahead",
        {"$name.detour": "Detour"},
        [
            "symaware sweep sweeps/$name.yaml -o $name-sweep",
            "symaware rows $name-sweep",
        ],
        "sweep",
    ),
    _kind(
        "drawing",
        "symaware.drawings",
        "tether",
        "A drawing: a line from each agent to the next",
        {"$name.tether": "Tether"},
        [
            "symaware plot $name.mcap --show $name-tether",
            "symaware replay $name.mcap",
        ],
        "plot",
    ),
    _kind(
        "command",
        "symaware.commands",
        "top_speed",
        "A verb that prints the top speed of each agent",
        {"$name-top-speed": "top_speed"},
        ["symaware $name-top-speed $name.mcap"],
    ),
    PluginScaffold(
        "section",
        "--section",
        "limits",
        "A section of scenarios: speed limits in regions",
        {"symaware.sections": {"${module}_limits": "Limits"}, "symaware.components": {"$name.obey": "Obey"}},
        [
            "symaware show $name.obey",
            "symaware log events $name.mcap",
        ],
    ),
    _kind(
        "export",
        "symaware.exports",
        "tab_separated",
        "An export format: tables with tabs between the columns",
        {"$name-tsv": "TabSeparated"},
        ["symaware export $name.mcap --format $name-tsv"],
    ),
    _kind(
        "report",
        "symaware.reports",
        "standstill",
        "A section of reports: how long each agent stood still",
        {"$name.standstill": "Standstill"},
        ["symaware report $name.mcap"],
        "plot",
    ),
    _kind(
        "result",
        "symaware.results",
        "plain_lines",
        "A format of results: a line of text for each test case",
        {"$name-lines": "PlainLines"},
        ["symaware validate scenarios/$name.yaml --results $name-lines:results.txt"],
    ),
    _kind(
        "search",
        "symaware.searches",
        "halving",
        "A search method: points that halve the largest gaps",
        {"$name-halving": "Halving"},
        [
            "symaware falsify scenarios/$name.yaml --specification apart --method $name-halving -o found \\",
            "  --over 'agents.robot.components.steer.with.speed={uniform: [0.2, 2.0]}'",
        ],
    ),
    _kind(
        "executor",
        "symaware.executors",
        "considerate",
        "An executor of sweeps that leaves processor cores to others",
        {"$name-considerate": "Considerate"},
        ["symaware sweep scenarios/$name.yaml --runs 8 --on $name-considerate:1 -o $name-sweep"],
        "sweep",
    ),
    _kind(
        "abstraction",
        "symaware.abstractions",
        "strips",
        "A knowledge model: a box cut into strips",
        {"$name.strips": "Strips"},
        [
            "symaware show $name.strips",
            "symaware plot $name.mcap",
        ],
    ),
)


def kind_chosen(purpose: str | None, flags: Sequence[str]) -> PluginScaffold:
    """Return the kind that options choose.

    Args:
        purpose: The value of ``--component``, if given.
        flags: The names of the flags that are given.

    Raises:
        ScaffoldError: There is none, or more than one.
    """
    chosen = [each for each in SCAFFOLDS if each.folder in ([purpose] if purpose else []) + list(flags)]
    if len(chosen) > 1:
        options = " and ".join(each.option for each in chosen)
        raise ScaffoldError(f"{options} are different kinds of plugins: choose one")
    if not chosen:
        purposes = [each.folder for each in SCAFFOLDS if each.option.startswith("--component ")]
        others = [each.option for each in SCAFFOLDS if not each.option.startswith("--component ")]
        options = ", ".join([f"--component {'|'.join(purposes)}", *others])
        raise ScaffoldError(f"say which kind of plugin to write, with one of {options}")
    return chosen[0]


def write_package(parent: Path, name: str, kind: PluginScaffold) -> None:
    """Write a package into a new folder.

    Args:
        parent: The folder that will contain it.
        name: The name of the package, of its folder and of its scenario.
        kind: The kind of its plugin.

    Raises:
        ScaffoldError: The name is invalid, something of this name exists, or the folder cannot be written; then there
            is no folder.
    """
    files = package_files(name, kind)
    folder = parent / name
    try:
        folder.mkdir()
    except FileExistsError:
        raise ScaffoldError(f"{folder} exists already") from None
    except OSError as error:
        raise ScaffoldError(f"cannot write {folder}: {(error.strerror or str(error)).lower()}") from error
    try:
        for path, content in files.items():
            place = folder / path
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(content, encoding="utf-8")
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError):
            raise ScaffoldError(f"cannot write {folder}: {(error.strerror or str(error)).lower()}") from error
        raise


def package_files(name: str, kind: PluginScaffold) -> Mapping[str, str]:
    """Return the files of a package: the content of each by its path.

    Raises:
        ScaffoldError: The name is invalid.
    """
    module = _module_of(name)
    names = {"name": name, "module": module}

    def filled(text: str) -> str:
        return Template(text).substitute(names)

    source = _text(f"{kind.folder}/plugin.py", names)
    required = [f"symaware-cli[{kind.extra}]" if kind.extra else "symaware-cli"]
    required += [each for each in _REQUIRED if re.search(rf"^\s*(?:import|from) {each}\b", source, re.MULTILINE)]
    tables = []
    for group, points in kind.points.items():
        lines = (f'"{filled(point)}" = "{module}.{kind.module}:{target}"' for point, target in points.items())
        tables.append("\n".join([f'[project.entry-points."{group}"]', *lines]))
    texts = {
        **names,
        "summary": kind.summary,
        "plugin": kind.module,
        "dependencies": ", ".join(f'"{each}"' for each in required),
        "entry_points": "\n\n".join(tables),
        "commands": "\n".join(f"    {filled(line)}" for line in kind.commands),
    }
    found = {
        "pyproject.toml": _text("package/pyproject.toml", texts),
        "README.md": _text("package/README.md", texts),
        f"src/{module}/__init__.py": _text("package/init.py", texts),
        f"src/{module}/{kind.module}.py": source,
        f"tests/test_{module}.py": _text(f"{kind.folder}/test.py", names),
        f"scenarios/{name}.yaml": _text(f"{kind.folder}/scenario.yaml", names),
    }
    if _template(f"{kind.folder}/sweep.yaml").exists():
        found[f"sweeps/{name}.yaml"] = _text(f"{kind.folder}/sweep.yaml", names)
    return found


def _module_of(name: str) -> str:
    """Return the module of a package.

    Raises:
        ScaffoldError: The name is not one of a distribution, or its module would hide another one.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9]*([-_][A-Za-z0-9]+)*", name) or len(name) > 64:
        raise ScaffoldError(
            f"`{name}` is not a name of a package: expected a letter, then at most 63 letters, digits and single - or "
            "_, not at the end"
        )
    module = name.replace("-", "_")
    if keyword.iskeyword(module) or keyword.issoftkeyword(module):
        raise ScaffoldError(f"`{name}` is not a name of a package: `{module}` is a keyword of Python")
    if module in sys.stdlib_module_names or find_spec(module) is not None:
        raise ScaffoldError(f"there is a module `{module}` already: choose another name")
    return module


def _template(path: str) -> Path:
    # With a suffix of its own, since a template is neither Python nor a scenario yet.
    return _TEMPLATES / f"{path}.txt"


def _text(path: str, values: Mapping[str, str]) -> str:
    return Template(_template(path).read_text(encoding="utf-8")).substitute(values)
