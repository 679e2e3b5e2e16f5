"""In-toto statements, unsigned or signed with Ed25519 in a DSSE envelope.

Formats: https://github.com/in-toto/attestation (Statement v1), https://github.com/secure-systems-lab/dsse.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symaware_cli.log import LogError, reason

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

TYPE = "https://in-toto.io/Statement/v1"
_PAYLOAD = "application/vnd.in-toto+json"


class SignatureError(LogError):
    """A key is invalid or cannot be read, or the module for signatures is not installed."""


@dataclass(frozen=True, slots=True)
class SignedStatement:
    """A statement with its signature, if signed.

    Attributes:
        content: The statement.
        signature: Its signature; None if unsigned.
        public_key: The raw public key named by the envelope, in hexadecimal; it does not identify the signer.
    """

    content: dict[str, Any]
    signature: bytes | None = None
    public_key: str | None = None
    _payload: bytes = b""

    def is_signed_by(self, public_key: str) -> bool:
        """Return whether the signature is valid under a raw public key, in hexadecimal."""
        from cryptography.exceptions import InvalidSignature
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

        try:
            key = Ed25519PublicKey.from_public_bytes(bytes.fromhex(public_key))
            key.verify(self.signature or b"", _encoded(self._payload))
        except (InvalidSignature, ValueError):
            return False
        return True


def canonical(content: Any) -> bytes:
    """Serialize plain data as canonical JSON (RFC 8785).

    Raises:
        LogError: The required module is not installed.
    """
    try:
        import rfc8785
    except ModuleNotFoundError:
        raise LogError(
            "certificates need the module `rfc8785`, which is not installed: pip install 'symaware-cli[evidence]'"
        ) from None
    return rfc8785.dumps(content)


def written(content: dict[str, Any], key: Path | None = None) -> bytes:
    """Serialize a statement, signed if a key is given: an unencrypted Ed25519 private key in PEM (PKCS 8).

    Raises:
        SignatureError: The file is not such a key, or the module for signatures is not installed.
    """
    payload = canonical(content)
    if key is None:
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False).encode() + b"\n"
    private = _private_key(key)
    public = private.public_key().public_bytes_raw().hex()
    signature = base64.b64encode(private.sign(_encoded(payload))).decode()
    envelope = {
        "payloadType": _PAYLOAD,
        "payload": base64.b64encode(payload).decode(),
        "signatures": [{"keyid": public, "sig": signature}],
    }
    return json.dumps(envelope, indent=1).encode() + b"\n"


def read_statement(content: bytes) -> SignedStatement:
    """Parse a statement with its signature, if signed; the signature is not verified.

    Raises:
        ValueError: The content is not a statement.
    """
    from symaware_cli.log import read_json

    try:
        found = read_json(content)
        if not isinstance(found, dict):
            raise ValueError("not a mapping")
        if "payload" not in found:
            return SignedStatement(_checked(found))
        if found["payloadType"] != _PAYLOAD:
            raise ValueError(f"payload of the type {found['payloadType']}")
        payload = base64.b64decode(found["payload"], validate=True)
        if len(found["signatures"]) != 1:
            raise ValueError("an envelope has one signature")
        (signature,) = found["signatures"]
        sealed = base64.b64decode(signature["sig"], validate=True)
        return SignedStatement(_checked(read_json(payload)), sealed, str(signature["keyid"]), payload)
    except (KeyError, TypeError, UnicodeError, binascii.Error) as error:
        raise ValueError(f"not a statement or an envelope: {error!r}") from None


def public_key_of(path: Path) -> str:
    """Return the raw public key of a PEM file with a public or private key, in hexadecimal.

    Raises:
        SignatureError: The file is not a key.
    """
    _require_cryptography()
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    try:
        content = path.read_bytes()
        if b"PRIVATE" in content:
            return _private_key(path).public_key().public_bytes_raw().hex()
        key: Ed25519PublicKey | Any = load_pem_public_key(content)
    except OSError as error:
        raise SignatureError(f"cannot read {path}: {reason(error)}") from None
    except ValueError:
        raise SignatureError(f"{path} is not a key in PEM") from None
    if not isinstance(key, Ed25519PublicKey):
        raise SignatureError(f"{path} is not a key of Ed25519")
    return key.public_bytes_raw().hex()


def fingerprint(public_key: str) -> str:
    """Return the fingerprint of a raw public key for comparison by people: its SHA-256."""
    return hashlib.sha256(bytes.fromhex(public_key)).hexdigest()


def _private_key(path: Path) -> Ed25519PrivateKey:
    _require_cryptography()
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        key = load_pem_private_key(path.read_bytes(), None)
    except OSError as error:
        raise SignatureError(f"cannot read {path}: {reason(error)}") from None
    except TypeError:
        raise SignatureError(f"{path} is encrypted; signing needs an unencrypted private key") from None
    except ValueError:
        raise SignatureError(f"{path} is not a private key in PEM") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise SignatureError(f"{path} is not a key of Ed25519; `openssl genpkey -algorithm ed25519` makes one")
    return key


def _require_cryptography() -> None:
    from importlib.util import find_spec

    if find_spec("cryptography") is None:
        raise SignatureError(
            "signatures need the module `cryptography`, which is not installed: pip install 'symaware-cli[evidence]'"
        )


def _checked(content: Any) -> dict[str, Any]:
    if not isinstance(content, dict) or content.get("_type") != TYPE or not isinstance(content.get("predicate"), dict):
        raise ValueError(f"not a statement of the type {TYPE}")
    return content


def _encoded(payload: bytes) -> bytes:
    """Return the bytes that are signed: the pre-authentication encoding of DSSE."""
    return b"DSSEv1 %d %s %d %s" % (len(_PAYLOAD), _PAYLOAD.encode(), len(payload), payload)
