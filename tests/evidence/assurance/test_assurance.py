"""Assurance cases depend on the present evidence: every solution is checked again, and goals show the result."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest
from sacm_metamodel import problems

import symaware_cli as sa
from symaware_cli.evidence import is_case
from symaware_cli.evidence.assurance.case_document import read_case

pytest.importorskip("pyarrow")

SCENARIO = """
symaware: 1
name: meeting
seed: 3
run: {duration: 0.3}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  robot:
    count: 2
    model: {use: single-integrator, with: {process_noise: 0.1}}
    state: [[0.0, 0.0], [4.0, 0.0]]
    components:
      sense: {use: perception.omniscient}
contracts: {sees: "always norm(belief(other) - truth(other)) < 0.5"}
specifications: {apart: {pairs: robot, formula: "always distance > 1"}}
"""

CASE = """
symaware-case: 1
name: Two robots <meet> & part
scenario: meeting.yaml
goals:
  G1: {text: The robots do not collide, by: [S1], context: [C1, A1]}
  G2: {text: Each is right about the other, by: [Sn1, Sn2]}
  G3: {text: Robots that are right keep their distance, by: [Sn3, Sn4, Sn5, Sn6]}
strategies:
  S1: {text: Over awareness and action, by: [G2, G3], context: [J1]}
solutions:
  Sn1: {certificate: swept/certificate.json, claim: "P(sees) > 0.5 with confidence 0.8"}
  Sn2: {budget: budget/budget.json, at_least: 0.2}
  Sn3: {certificate: swept/certificate.json, claim: "P(apart | sees) > 0.5 with confidence 0.8"}
  Sn4: {falsification: search.json, specification: apart}
  Sn5: {log: run.mcap, specification: apart}
  Sn6: {log: other.mcap, specification: apart, text: Another seed}
context: {C1: An empty hall}
assumptions: {A1: The noise is Gaussian}
justifications: {J1: Nothing else moves}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a case, its evidence, and the case as it was written."""
    folder = tmp_path_factory.mktemp("case")
    scenario = folder / "meeting.yaml"
    scenario.write_text(SCENARIO)
    (folder / "case.yaml").write_text(CASE)
    claim = "P(sees) > 0.5; P(apart | sees) > 0.5 with confidence 0.8"
    sa.sweep(scenario, output=folder / "swept", runs=8, claim=claim)
    sa.certify(folder / "swept")
    over = "agents.robot.model.with.process_noise=0.1,0.2"
    sa.budget(scenario, folder / "budget", claim="P(apart) > 0.5 with confidence 0.8", over=over, runs=8)
    found = sa.falsify(scenario, "apart", seeds=5, runs=3, method="random")
    (folder / "search.json").write_text(json.dumps(found.to_json()))
    sa.load(scenario).run(output=folder / "run.mcap")
    sa.load(scenario, seed=4).run(output=folder / "other.mcap")
    sa.assure(folder / "case.yaml", folder / "assured", rows=1)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of that folder."""
    shutil.copytree(made, tmp_path / "case")
    return tmp_path / "case"


def verified(folder: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Return the status of each goal, and the problems of solutions."""
    case = sa.verify_case(folder / "assured", "arithmetic")
    goals = {name: case.statuses[name] for name in case.document.goals}
    return goals, {name: problem for name, problem in case.problems.items() if problem is not None}


def test_a_case_whose_evidence_holds_is_supported(folder: Path) -> None:
    assert is_case(folder / "assured")
    assert verified(folder) == ({"G1": "holds", "G2": "holds", "G3": "holds"}, {})
    assert json.loads((folder / "assured" / "case.json").read_text())["supported"]


def test_evidence_that_changed_turns_its_goals_red(folder: Path) -> None:
    shutil.copy(folder / "other.mcap", folder / "run.mcap")
    goals, problems = verified(folder)
    assert goals == {"G1": "fails", "G2": "holds", "G3": "fails"}
    assert problems == {"Sn5": "stale: its file has changed since the case was written"}
    assert "#c62828" in (folder / "assured" / "case.svg").read_text()


def test_removed_evidence_is_missing(folder: Path) -> None:
    (folder / "search.json").unlink()
    shutil.rmtree(folder / "budget" / "level-001")
    goals, problems = verified(folder)
    assert goals == {"G1": "fails", "G2": "fails", "G3": "fails"}
    assert problems["Sn4"] == "missing: there is no file search.json"
    assert problems["Sn2"].startswith("missing: budget.json lacks the certificate of the level 0.2")


def test_evidence_for_another_scenario_is_stale(folder: Path) -> None:
    scenario = folder / "meeting.yaml"
    scenario.write_text(SCENARIO.replace("process_noise: 0.1", "process_noise: 0.3"))
    _, problems = verified(folder)
    assert set(problems) == {"Sn1", "Sn2", "Sn3", "Sn4", "Sn5", "Sn6"}
    assert set(problems.values()) == {"stale: meeting.yaml has changed since it was made"}


def test_a_forged_table_is_found(folder: Path) -> None:
    (folder / "swept" / "identity.json").write_text("{}")
    goals, problems = verified(folder)
    assert set(problems) == {"Sn1", "Sn3"}
    assert goals["G1"] == "fails"


@pytest.mark.parametrize(
    ("written", "instead", "name", "said"),
    [
        ("P(sees) > 0.5", "P(sees) > 0.9", "Sn1", "another claim"),
        ("P(sees) > 0.5 with confidence 0.8", "P(sees) > 0.5 with confidence 0.9", "Sn1", "another claim"),
        ("at_least: 0.2", "at_least: 0.4", "Sn2", "another claim: 0.4 is not a level"),
        ("specification: apart}", "specification: sees}", "Sn4", "another claim: the search was about apart"),
        ("search.json, specification: apart", "swept/identity.json, specification: apart", "Sn4", "unreadable"),
        (
            "run.mcap, specification: apart",
            "run.mcap, specification: near",
            "Sn5",
            "near is not monitored",
        ),
        ("run.mcap, specification: apart", "case.yaml, specification: apart", "Sn5", "unsound"),
    ],
)
def test_evidence_that_does_not_establish_its_claim_is_refused(
    folder: Path, written: str, instead: str, name: str, said: str
) -> None:
    case = folder / "case.yaml"
    case.write_text(CASE.replace(written, instead, 1))
    found = sa.assure(case, folder / "again", level="arithmetic")
    assert not found.is_supported
    assert said in (found.problems[name] or "")


@pytest.mark.parametrize(
    ("written", "instead", "line", "said"),
    [
        ("by: [S1]", "by: [S2]", 6, "nothing is called `S2`"),
        ("by: [S1]", "by: [S1, C1]", 6, "`C1` is in `context`, which is not allowed here"),
        ("by: [Sn1, Sn2]", "by: [Sn1, Sn2, G1]", 7, "`G2` supports itself"),
        ("A1: The", "A2: The", 6, "nothing is called `A1`"),
        ("at_least: 0.2", "claim: P(sees) > 0.5", 13, "does not take `claim`"),
        ("specification: apart}", "log: run.mcap}", 15, "names one of certificate"),
        ('claim: "P(sees) > 0.5 with', 'claim: "P(sees) 0.5 with', 12, "a claim is written like"),
        ("C1: An empty", "G1: An empty", 18, "`G1` is in `goals` already"),
        ("text: Another seed", "tekst: Another seed", 17, "unknown key `tekst`"),
    ],
)
def test_problems_of_a_case_are_located(tmp_path: Path, written: str, instead: str, line: int, said: str) -> None:
    case = tmp_path / "case.yaml"
    assert written in CASE
    case.write_text(CASE.replace(written, instead, 1))
    with pytest.raises(sa.ScenarioError) as raised:
        read_case(case)
    found = [(each.span.line if each.span else 0, each.message) for each in raised.value.problems]
    assert any(place == line and said in message for place, message in found), found


def test_the_case_is_drawn_and_exchanged_without_entities(made: Path) -> None:
    picture = ElementTree.fromstring((made / "assured" / "case.svg").read_text())
    texts = {each.text for each in picture.iter("{http://www.w3.org/2000/svg}text")}
    assert {"G1", "S1", "Sn6", "C1", "A1", "J1", "A", "J"} <= texts
    written = (made / "assured" / "case.sacm.xml").read_text()
    assert "<!" not in written
    root = ElementTree.fromstring(written)
    kinds = [each.get("{http://www.w3.org/2001/XMLSchema-instance}type") for each in root.iter("argumentationElement")]
    assert kinds.count("argumentation_:Claim") == 5
    assert kinds.count("argumentation_:AssertedEvidence") == 6
    assert kinds.count("argumentation_:AssertedInference") == 1
    assert kinds.count("argumentation_:AssertedContext") == 3
    page = (made / "assured" / "index.html").read_text()
    assert "Two robots &lt;meet&gt; &amp; part" in page
    assert "<svg" in page


def test_the_exchanged_case_conforms_to_the_metamodel(folder: Path) -> None:
    written = (folder / "assured" / "case.sacm.xml").read_text()
    assert list(problems(written)) == []
    (folder / "run.mcap").unlink()
    verified(folder)
    red = (folder / "assured" / "case.sacm.xml").read_text()
    assert list(problems(red)) == []
    assert 'assertionDeclaration="defeated"' in red


@pytest.mark.parametrize(
    ("written", "instead", "said"),
    [
        ("argumentation_:Claim", "argumentation_:Goal", "Goal is no class of elements"),
        ('isCounter="false" ', "", "has 0 of isCounter"),
        ('assertionDeclaration="assumed"', 'assertionDeclaration="hoped"', "is hoped"),
        ('source="Sn1"', 'source="Sn9"', "AssertedEvidence.source refers to Sn9"),
        ('reasoning="S1"', 'reasoning="G2"', "AssertedInference.reasoning refers to G2"),
        ("<description>", "<descriptions/><description>", "contains no descriptions"),
    ],
)
def test_the_check_against_the_metamodel_finds_violations(made: Path, written: str, instead: str, said: str) -> None:
    text = (made / "assured" / "case.sacm.xml").read_text()
    assert written in text
    assert any(said in each for each in problems(text.replace(written, instead, 1)))


def test_a_goal_without_support_is_undeveloped(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text(
        "symaware-case: 1\nname: begun\ngoals: {G1: {text: Safe, by: [G2]}, G2: {text: Awake}}\n"
    )
    case = sa.assure(tmp_path / "case.yaml", tmp_path / "out")
    assert dict(case.statuses) == {"G2": "open", "G1": "open"}
    assert not case.is_supported
