"""Certification of sweeps: certificates are created from the folder of a sweep and verified against it."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from symaware_cli.evidence.certificate import POST_HOC, leaves, statement
from symaware_cli.evidence.certificate_check import CERTIFICATE, certificate_findings, opened
from symaware_cli.evidence.certificate_page import page
from symaware_cli.evidence.finding import Finding
from symaware_cli.evidence.signed_statement import public_key_of, written
from symaware_cli.evidence.sweep_verification import Level, SweepVerification, require_sound, verify_folder
from symaware_cli.language import FilePath
from symaware_cli.log import OutputError, whole_file
from symaware_cli.studies import Claim, SweepError, SweepFolder, is_sweep, require_pyarrow


@dataclass(frozen=True, slots=True)
class Certificate:
    """The decision on the claim of a sweep, and its files if written.

    Attributes:
        statement: The in-toto statement.
        path: The certificate; None if none was written.
        page: The printable page; None if none was written.
        public_key: The raw public key of its signature, in hexadecimal; None if it is unsigned.
    """

    statement: Mapping[str, Any]
    path: Path | None = None
    page: Path | None = None
    public_key: str | None = None

    @property
    def is_established(self) -> bool:
        """Whether the claim is established for all combinations."""
        return bool(self.statement["predicate"]["established"])

    @property
    def is_post_hoc(self) -> bool:
        """Whether the claim was not in the plan of the sweep."""
        return bool(self.statement["predicate"]["claim"]["stated"] == POST_HOC)

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            "established": self.is_established,
            "post_hoc": self.is_post_hoc,
            "certificate": None if self.path is None else str(self.path),
            "page": None if self.page is None else str(self.page),
            "public_key": self.public_key,
            "statement": self.statement,
        }


@dataclass(frozen=True, slots=True)
class CertificateVerification:
    """The result of verifying a certificate.

    Attributes:
        path: The certificate.
        public_key: The raw public key of its signature, in hexadecimal; None if it is unsigned.
        is_known_signer: Whether the signature is valid under the requested key.
        findings: The contradictions between the certificate and the folder.
        sweep: The verification of the folder.
    """

    path: Path
    public_key: str | None
    is_known_signer: bool
    findings: Sequence[Finding]
    sweep: SweepVerification

    @property
    def is_sound(self) -> bool:
        """Whether there are no findings."""
        return not self.findings and self.sweep.is_sound

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {
            "sound": self.is_sound,
            "certificate": str(self.path),
            "public_key": self.public_key,
            "known_signer": self.is_known_signer,
            "findings": [asdict(each) for each in self.findings],
            "sweep": self.sweep.to_json(),
        }


def certify(
    folder: FilePath, *, claim: str | None = None, key: FilePath | None = None, output: FilePath | None = None
) -> Certificate:
    """Decide the claim of a sweep, and write a certificate if it is established for any combination.

    Next to the certificate, a printable page (``.html``) and the hashes of the rows (``.leaves``) are written.

    Args:
        folder: The folder of a finished sweep.
        claim: A claim that is not in its plan: evaluated post hoc, never signed, and written only if `output` is given.
        key: A file with an unencrypted Ed25519 private key in PEM format, for the signature.
        output: The path of the certificate; by default ``certificate.json`` in the folder.

    Raises:
        SweepError: The sweep does not exist, has no claim or is unfinished, or its table contradicts its plan.
        LogError: The key is invalid, or a package is missing.
        OutputError: The certificate cannot be written.
        ValueError: The claim is invalid.
    """
    require_pyarrow()
    sweep = SweepFolder.opened(folder)
    post_hoc = None if claim is None else Claim.parse(claim)
    if post_hoc is not None and key is not None:
        raise SweepError("a claim that was stated afterwards is not signed: omit --key")
    content = statement(sweep, post_hoc)
    require_sound(sweep)
    public_key = None if key is None else public_key_of(Path(key))
    made = Certificate(content, public_key=public_key)
    if not any(each["established"] for each in content["predicate"]["combinations"]):
        return made
    if post_hoc is not None and output is None:
        return made
    path = sweep.path / CERTIFICATE if output is None else Path(output)
    texts = {
        path: written(content, None if key is None else Path(key)),
        path.with_suffix(".html"): page(content, public_key).encode(),
        path.with_suffix(".leaves"): "".join(f"{index} {hashed}\n" for index, hashed in leaves(sweep)).encode(),
    }
    if len(texts) < 3:
        raise OutputError(f"cannot write {path}: choose a name that ends with .json")
    for each, text in texts.items():
        with whole_file(each) as partial:
            partial.write_bytes(text)
    return Certificate(content, path, path.with_suffix(".html"), public_key)


def verify_certificate(
    path: FilePath,
    level: Level = "sample",
    *,
    key: FilePath | None = None,
    folder: FilePath | None = None,
    rows: int = 20,
    seed: int | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> CertificateVerification:
    """Verify the signature of a certificate, its statement against the folder of its sweep, and that folder.

    Args:
        path: The certificate.
        level: The extent of the folder's verification; see `verify_sweep`.
        key: A file with the required key in PEM format; None for any key.
        folder: The folder of the sweep; by default that of the certificate.
        rows: See `verify_sweep`.
        seed: See `verify_sweep`.
        on_progress: See `verify_sweep`.

    Raises:
        SweepError: There is no sweep.
        LogError: The certificate cannot be read.
    """
    path = Path(path)
    place = path.parent if folder is None else Path(folder)
    read = opened(path)
    if not is_sweep(place):
        raise SweepError(
            f"{place} is not the folder of the sweep that {path} is about: a certificate is verified there"
        )
    wanted = None if key is None else public_key_of(Path(key))
    sweep = SweepFolder.opened(place)
    findings = list(certificate_findings(sweep, path, read, wanted))
    chosen = secrets.randbits(32) if seed is None else seed
    result = verify_folder(sweep, level, rows, chosen, on_progress, with_certificates=False)
    is_known = wanted is not None and read.public_key == wanted and read.is_signed_by(wanted)
    return CertificateVerification(path, read.public_key, is_known, findings, result)
