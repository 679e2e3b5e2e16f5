"""Claims of sweeps are certified if the runs establish them, and any later change is detected."""

import ast
import base64
import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import rfc8785
from checkout import CHECKOUT
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)
from sweeping import rows, symaware, tiny

import symaware_cli as sa
from symaware_cli.studies.claim import Claim
from symaware_cli.studies.claim_term import ClaimTerm

CHECK = CHECKOUT / "docs" / "check_certificate.py"
CLAIM = "P(near) > 0.5 with confidence 0.99, sequential"
#: Always satisfied: the robots cannot get so far.
SAFE = 'specifications.near.formula="always position[1] < 9"'


def swept(folder: Path, *options: object, claim: str = CLAIM, status: int = 0) -> Path:
    out = folder / "out"
    symaware(
        "sweep", tiny(folder), "-o", out, "--jobs", 0, "--quiet", "--with", f"claim={claim}", *options, status=status
    )
    return out


def derived(folder: Path) -> subprocess.CompletedProcess[str]:
    """Derive the certificate again without the package."""
    return subprocess.run([sys.executable, "-I", CHECK, folder], capture_output=True, text=True, check=False)


def test_the_script_is_short_and_needs_only_python() -> None:
    text = CHECK.read_text()
    tree = ast.parse(text)
    described = {line for node in ast.walk(tree) for line in described_lines(node)}
    lines = [
        number
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.strip().startswith("#") and number not in described
    ]
    assert len(lines) <= 160
    assert max(map(len, text.splitlines())) <= 120
    modules = {each.name for node in ast.walk(tree) if isinstance(node, ast.Import) for each in node.names}
    modules |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert modules <= sys.stdlib_module_names


def described_lines(node: ast.AST) -> range:
    """Return the lines of a docstring."""
    if not isinstance(node, ast.Module | ast.FunctionDef) or ast.get_docstring(node) is None:
        return range(0)
    return range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1)


@pytest.mark.parametrize("text", ["near > 0.9", "P(near) > 1", "P(near) > 0.9, later", "P(near) > x", "P() > 0.9"])
def test_invalid_claims_are_rejected(text: str) -> None:
    with pytest.raises(ValueError, match=r"claim|probability"):
        Claim.parse(text)


def test_a_claim_round_trips_through_text() -> None:
    assert str(Claim.parse(CLAIM)) == CLAIM
    assert Claim.parse("P(near) > 0.9") == Claim((ClaimTerm(("near",), 0.9),), 0.99, "fixed")


def test_an_established_sequential_claim_ends_the_sweep(tmp_path: Path) -> None:
    out = swept(tmp_path, "--runs", 300, "--set", SAFE)
    needed = Claim.parse(CLAIM).least_runs(1)
    assert len(rows(out)) == needed < 300
    made = sa.certify(out)
    assert made.is_established
    assert not made.is_post_hoc
    assert made.statement["predicate"]["combinations"][0]["runs"] == needed
    assert made.page is not None
    assert "established" in made.page.read_text()
    assert sa.verify_certificate(out / "certificate.json", "all").is_sound
    assert derived(out).stdout.endswith("the certificate follows from the folder\n")


def test_a_fixed_claim_is_decided_by_all_planned_runs(tmp_path: Path) -> None:
    claim = "P(near) > 0.5 with confidence 0.99, fixed"
    out = swept(tmp_path, "--runs", 7, "--set", SAFE, claim=claim)
    assert sa.certify(out).is_established
    assert derived(out).returncode == 0
    assert "no runs can be added" in symaware("resume", out, "--add-runs", 10, status=2)


def test_the_claim_of_a_file_can_be_removed_for_uncertified_runs(tmp_path: Path) -> None:
    tiny(tmp_path)
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text("symaware-sweep: 1\nscenario: tiny.yaml\nruns: 400\nclaim: P(near) > 0.9\n")
    said = symaware("sweep", sweep, "-o", tmp_path / "few", "--runs", 1, status=2)
    assert "--with claim=none" in said
    symaware("sweep", sweep, "-o", tmp_path / "few", "--runs", 1, "--jobs", 0, "--quiet", "--with", "claim=none")
    assert "has no claim" in symaware("certify", tmp_path / "few", status=2)


def test_added_runs_may_decide_a_sequential_claim(tmp_path: Path) -> None:
    out = swept(tmp_path, "--runs", 5, "--set", SAFE)
    assert "not certified" in symaware("certify", out, status=3)
    assert not (out / "certificate.json").exists()
    symaware("resume", out, "--add-runs", 20, "--jobs", 0)
    assert "certified" in symaware("certify", out)


def test_failed_and_undecided_runs_count_against_a_claim(tmp_path: Path) -> None:
    late = 'specifications.near.formula="eventually[0, 9] position[1] > 5"'
    out = swept(tmp_path, "--runs", 20, "--set", late)
    (cell,) = json.loads(symaware("certify", out, "--json", status=3))["statement"]["predicate"]["combinations"]
    assert cell["against"] == {"violated": 0, "undecided": 20, "failed": 0, "lost": 0}
    assert cell["satisfied"] == 0


def test_each_combination_has_a_separate_claim_and_all_hold_jointly(tmp_path: Path) -> None:
    out = swept(tmp_path, "--runs", 100, "--set", SAFE, "--over", "agents.robot.count=1,2")
    said = sa.certify(out).statement["predicate"]
    assert [each["needed"] for each in said["combinations"]] == [200.0, 200.0]
    assert {each["runs"] for each in said["combinations"]} == {Claim.parse(CLAIM).least_runs(2)}
    assert "Bonferroni" in said["probability_over"]
    assert derived(out).returncode == 0


def test_a_post_hoc_claim_is_neither_signed_nor_certified(tmp_path: Path) -> None:
    out = swept(tmp_path, "--runs", 300, "--set", SAFE)
    key = private_key(tmp_path)
    said = symaware("certify", out, "--claim", "P(near) > 0.4", "--key", key, status=2)
    assert "not signed" in said
    assert "POST HOC, not certified" in symaware("certify", out, "--claim", "P(near) > 0.4")
    assert not (out / "certificate.json").exists()
    made = sa.certify(out, claim="P(near) > 0.4", output=tmp_path / "later.json")
    assert made.is_post_hoc
    assert made.page is not None
    assert "not a certificate" in made.page.read_text()
    assert sa.verify_certificate(tmp_path / "later.json", "arithmetic", folder=out).is_sound


def test_a_claim_added_to_the_plan_afterwards_is_detected(tmp_path: Path) -> None:
    out = tmp_path / "out"
    symaware("sweep", tiny(tmp_path), "-o", out, "--runs", 20, "--jobs", 0, "--set", SAFE)
    plan = out / "sweep.yaml"
    plan.write_text(plan.read_text() + "claim: P(near) > 0.5\n")
    assert "contradicts itself" in symaware("certify", out, status=2)


@pytest.mark.parametrize("design", ["sobol", "latin-hypercube"])
def test_dependent_runs_are_rejected(tmp_path: Path, design: str) -> None:
    options = (
        "--with",
        f"design={design}",
        "--over",
        "agents.robot.model.with.max_speed={uniform: [0.5, 1]}",
        "--runs",
        "64",
    )
    assert "independent" in symaware("plan", tiny(tmp_path), "--with", f"claim={CLAIM}", *options, status=2)
    symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "--jobs", 0, *options)
    assert "not independent" in symaware("certify", tmp_path / "out", "--claim", CLAIM, status=2)


def private_key(folder: Path, name: str = "key.pem") -> Path:
    key = Ed25519PrivateKey.generate()
    path = folder / name
    path.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    public = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    path.with_suffix(".pub").write_bytes(public)
    return path


@pytest.fixture
def certified(tmp_path: Path) -> Path:
    """A sweep with a signed certificate."""
    out = swept(tmp_path, "--runs", 300, "--set", SAFE)
    sa.certify(out, key=private_key(tmp_path))
    return out


def findings(folder: Path, **options: Any) -> list[tuple[int | None, str]]:
    """Return the places of findings in a certificate and its folder."""
    result = sa.verify_certificate(folder / "certificate.json", "arithmetic", **options)
    return [(each.index, each.column) for each in (*result.findings, *result.sweep.findings)]


def test_a_signature_names_its_key(certified: Path, tmp_path: Path) -> None:
    assert findings(certified, key=tmp_path / "key.pub") == []
    assert findings(certified, key=private_key(tmp_path, "other.pem")) == [(None, "signature")]


def test_a_signer_is_known_only_if_the_requested_key_matches(certified: Path, tmp_path: Path) -> None:
    path, other = certified / "certificate.json", private_key(tmp_path, "other.pem")
    accepted = symaware("verify", path, "--level", "arithmetic", "--key", tmp_path / "key.pub")
    assert "the key that was asked for" in accepted
    refused = symaware("verify", path, "--level", "arithmetic", "--key", other, status=1)
    assert refused.startswith(f"{path}: 1 finding\n")
    assert "which is not accepted" in refused
    assert "asked for" not in refused
    assert not sa.verify_certificate(path, "arithmetic", key=other).is_known_signer
    envelope = json.loads(path.read_text())
    envelope["signatures"][0]["sig"] = base64.b64encode(bytes(64)).decode()
    path.write_text(json.dumps(envelope))
    forged = sa.verify_certificate(path, "arithmetic", key=tmp_path / "key.pub")
    assert not forged.is_known_signer
    assert not forged.is_sound


def test_invalid_keys_are_rejected_with_clear_messages(certified: Path, tmp_path: Path) -> None:
    assert "[Errno" not in symaware("certify", certified, "--key", tmp_path / "none.pem", status=2)
    encrypted = tmp_path / "encrypted.pem"
    key = Ed25519PrivateKey.generate()
    encrypted.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret")))
    assert "needs an unencrypted private key" in symaware("certify", certified, "--key", encrypted, status=2)
    assert "not a private key in PEM" in symaware("certify", certified, "--key", tmp_path / "key.pub", status=2)
    assert "--key is for certificates" in symaware("verify", certified, "--key", tmp_path / "key.pub", status=2)


def test_the_script_without_a_folder_prints_its_usage(certified: Path) -> None:
    said = derived(certified / "certificate.json")
    assert said.returncode == 1
    assert "python check_certificate.py DIR" in said.stderr
    assert "Traceback" not in said.stderr
    envelope = json.loads((certified / "certificate.json").read_text())
    payload = base64.b64decode(envelope["payload"])
    assert payload == rfc8785.dumps(json.loads(payload))
    assert derived(certified).returncode == 0


def test_a_changed_statement_is_detected(certified: Path) -> None:
    file = certified / "certificate.json"
    envelope = json.loads(file.read_text())
    content = json.loads(base64.b64decode(envelope["payload"]))
    content["predicate"]["combinations"][0]["runs"] = 1000
    envelope["payload"] = base64.b64encode(rfc8785.dumps(content)).decode()
    file.write_text(json.dumps(envelope))
    changed = [(None, "signature"), (None, "predicate.combinations[0].runs"), (None, "certificate.html")]
    assert findings(certified) == changed
    assert derived(certified).returncode == 1


@pytest.mark.parametrize(
    ("column", "value"),
    [("verdicts", '{"near": "violated"}'), ("digest", "00"), ("seed", 5), ("metrics", "{}"), ("state", "failed")],
)
def test_a_changed_row_is_located(certified: Path, column: str, value: object) -> None:
    with closing(sqlite3.connect(certified / "journal.sqlite")) as journal, journal:
        journal.execute(f'UPDATE runs SET {column} = ? WHERE "index" = 5', (value,))
    found = findings(certified)
    assert (5, "row") in found
    assert {index for index, _ in found} == {None, 5}
    assert "signature" not in [name for _, name in found]
    assert derived(certified).returncode == 1


def test_invalid_certificates_are_rejected(certified: Path, tmp_path: Path) -> None:
    for content in (b"", b"[]", b"{}", b'{"payload": 5}', b'{"_type": "x"}', b"\xff"):
        (certified / "certificate.json").write_bytes(content)
        assert "is not a certificate" in symaware("verify", certified / "certificate.json", status=2)
    assert "cannot read" in symaware("verify", certified / "none.json", status=2)


DAMAGES: dict[str, tuple[str, bytes | str]] = {
    "garbage for a table": ("runs.parquet", b"PAR1 is not enough"),
    "garbage for a journal": ("journal.sqlite", b"no database" * 100),
    "garbage for an identity": ("identity.json", b"{]"),
    "an identity of nothing": ("identity.json", b"{}"),
    "metrics that are no JSON": ("journal.sqlite", "UPDATE runs SET metrics = '[1' WHERE \"index\" = 1"),
    "metrics that are a list": ("journal.sqlite", "UPDATE runs SET metrics = '[1]' WHERE \"index\" = 1"),
    "text that is none": ("journal.sqlite", "UPDATE runs SET metrics = CAST(x'ff' AS TEXT) WHERE \"index\" = 1"),
    "a seed that is none": ("journal.sqlite", "UPDATE runs SET seed = 'x' WHERE \"index\" = 1"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_folder_is_rejected_naming_the_damaged_file(certified: Path, damage: str) -> None:
    name, change = DAMAGES[damage]
    if isinstance(change, bytes):
        (certified / name).write_bytes(change)
    else:
        with closing(sqlite3.connect(certified / name)) as journal, journal:
            journal.execute(change)
    (certified / "certificate.html").unlink()
    for verb in (["verify", certified, "--level", "arithmetic"], ["certify", certified]):
        said = symaware(*verb, status=2)
        assert said.startswith("symaware: ")
        assert "is damaged" in said
        assert "--claim" not in said
    assert not (certified / "certificate.html").exists()


def test_an_envelope_without_a_signature_is_rejected(certified: Path) -> None:
    path = certified / "certificate.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"signatures": []}))
    assert "not a certificate: an envelope has one signature" in symaware("verify", path, status=2)


@pytest.mark.parametrize("failing", [0, 100])
def test_the_script_decides_claims_with_many_runs(tmp_path: Path, failing: int) -> None:
    claim = "P(near) > 0.1 with confidence 0.9" if failing else "P(near) > 0.5 with confidence 0.9"
    out = swept(tmp_path, "--runs", 1_200, "--set", SAFE, "--set", "run.duration=0.1", claim=claim)
    sa.certify(out)
    with closing(sqlite3.connect(out / "journal.sqlite")) as journal, journal:
        journal.execute("UPDATE runs SET state = 'failed' WHERE \"index\" < ?", (5 * failing,))
    said = derived(out)
    assert "Traceback" not in said.stderr
    assert f"combination 0: 1200 runs, {5 * failing} against, evidence " in said.stdout
    assert said.returncode == (1 if failing else 0)
