"""Checks of a certificate against the folder of its sweep: signature, statement, page and row hashes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from symaware_cli.evidence.certificate import POST_HOC, leaves, statement
from symaware_cli.evidence.certificate_page import page
from symaware_cli.evidence.finding import Finding
from symaware_cli.evidence.signed_statement import SignedStatement, fingerprint, read_statement
from symaware_cli.log import LogError, reason
from symaware_cli.studies import IDENTITY, Claim, SweepError, SweepFolder

#: The name of a certificate in the folder of its sweep.
CERTIFICATE = "certificate.json"


def certificates(folder: SweepFolder) -> list[Path]:
    """Return the certificates in a folder, sorted: `CERTIFICATE`, and other JSON files that declare to be one."""
    found = sorted(each for each in folder.path.glob("*.json") if each.name != IDENTITY and each.is_file())
    return [each for each in found if each.name == CERTIFICATE or _is_statement(each)]


def _is_statement(path: Path) -> bool:
    try:
        content = path.read_bytes()
    except OSError:
        return False
    return b'"_type"' in content or b'"payloadType"' in content


def opened(path: Path) -> SignedStatement:
    """Read a certificate.

    Raises:
        LogError: The file cannot be read, or is not a certificate.
    """
    try:
        return read_statement(path.read_bytes())
    except OSError as error:
        raise LogError(f"cannot read {path}: {reason(error)}") from None
    except ValueError as error:
        raise LogError(f"{path} is not a certificate: {error}") from None


def certificate_findings(
    folder: SweepFolder, path: Path, read: SignedStatement, wanted: str | None = None
) -> Iterator[Finding]:
    """Yield contradictions between the folder and a certificate or the files that accompany it.

    Args:
        folder: The folder of its sweep.
        path: The certificate.
        read: Its statement and signature.
        wanted: The required raw public key, in hexadecimal; None for any.
    """
    yield from _of_signature(read, wanted)
    yield from _of_statement(folder, read)
    yield from _of_page(read, path)
    yield from _of_rows(folder, path)


def _of_page(read: SignedStatement, path: Path) -> Iterator[Finding]:
    """Yield a finding if the printable page does not match the statement."""
    file = path.with_suffix(".html")
    try:
        if file.is_file() and file.read_bytes() != page(read.content, read.public_key).encode():
            yield Finding(None, file.name, "another page", f"the content of {path.name}")
    except (LookupError, TypeError, ValueError, AttributeError):
        yield Finding(None, file.name, "a page", f"nothing: {path.name} lacks the content of a page")


def _of_signature(read: SignedStatement, wanted: str | None) -> Iterator[Finding]:
    """Yield the faults of the signature."""
    if read.public_key is None:
        if wanted is not None:
            yield Finding(None, "signature", "none", f"one by the key {fingerprint(wanted)}")
        return
    if not read.is_signed_by(read.public_key):
        yield Finding(None, "signature", "a signature of another statement", "a signature of this statement")
    if wanted not in (None, read.public_key):
        yield Finding(None, "signature", f"one by the key {read.public_key}", f"one by the key {wanted}")


def _of_statement(folder: SweepFolder, read: SignedStatement) -> Iterator[Finding]:
    """Yield the contradictions between the statement and the folder."""
    said = read.content["predicate"].get("claim", {})
    post_hoc = None
    if isinstance(said, dict) and said.get("stated") == POST_HOC:
        try:
            post_hoc = Claim.parse(str(said.get("text")))
        except ValueError as error:
            yield Finding(None, "predicate.claim.text", said.get("text"), f"a claim: {error}")
            return
    try:
        expected = statement(folder, post_hoc)
    except SweepError as error:
        yield Finding(None, "predicate.claim", said, str(error))
        return
    yield from _differences("", read.content, expected)


def _of_rows(folder: SweepFolder, path: Path) -> Iterator[Finding]:
    """Yield the rows that differ from the certified ones according to the hashes that accompany the certificate."""
    file = path.with_suffix(".leaves")
    if not file.is_file():
        return
    lines = (line.split() for line in file.read_text(errors="replace").splitlines())
    noted = {words[0]: words[1] for words in lines if len(words) == 2}
    for index, hashed in leaves(folder):
        then = noted.pop(str(index), "nothing")
        if then != hashed:
            yield Finding(index, "row", f"hash {hashed}", f"{then}, as it was certified")
    for name in noted:
        yield Finding(None, "rows", f"no row {name}", f"{noted[name]}, as it was certified")


def _differences(place: str, found: Any, expected: Any) -> Iterator[Finding]:
    """Yield the values in which two trees of plain data differ."""
    if isinstance(found, Mapping) and isinstance(expected, Mapping):
        for name in dict.fromkeys([*expected, *found]):
            yield from _differences(f"{place}.{name}".strip("."), found.get(name), expected.get(name))
    elif isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        for number, (one, other) in enumerate(zip(found, expected, strict=True)):
            yield from _differences(f"{place}[{number}]", one, other)
    elif found != expected or isinstance(found, bool) != isinstance(expected, bool):
        yield Finding(None, place, found, expected)
