"""Seals: encrypted labels of hidden physics, with commitments that reveal any change.

The commitment is the SHA-256 of a secret nonce of 32 bytes and the label. It does not reveal the label and
fits no other one. The label is encrypted with ChaCha20-Poly1305 (RFC 8439), which authenticates it together
with the rig's name and the commitment.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import json
import secrets
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from irt.errors import IrtError
from irt.extras import require

_SECRET_BYTES = 32
_COUNTER_BYTES = 12


@dataclass(frozen=True)
class Seal:
    """The published seal of a rig.

    Attributes
    ----------
    rig : str
        Its name.
    commitment : str
        SHA-256 over nonce and label, hexadecimal.
    sealed : str
        The encrypted label, base64.
    """

    rig: str
    commitment: str
    sealed: str

    def as_dict(self) -> dict[str, str]:
        """Return the seal as JSON content."""
        return asdict(self)


@dataclass(frozen=True)
class Key:
    """The key of a seal: the cipher's key and the commitment's nonce, 32 bytes each, hexadecimal."""

    key: str
    nonce: str

    def as_dict(self) -> dict[str, str]:
        """Return the key as JSON content."""
        return asdict(self)


def canonical(content: Any) -> bytes:
    """Return content as canonical JSON bytes, the same on any machine.

    Raises
    ------
    IrtError
        If it holds values that JSON does not have, such as NaN.
    """
    try:
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False).encode("ascii")
    except (TypeError, ValueError) as error:
        raise IrtError(f"cannot be written as JSON: {error}") from error


def digest(data: bytes) -> str:
    """Return the SHA-256 of bytes, hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def digests(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file of a folder, by name."""
    return {path.name: digest(path.read_bytes()) for path in sorted(folder.iterdir()) if path.is_file()}


def close(rig: str, label: Mapping[str, Any]) -> tuple[Seal, Key]:
    """Seal the label of a rig with a fresh key and a fresh nonce.

    Raises
    ------
    IrtError
        If the label cannot be written as JSON, or the package that encrypts is missing.
    """
    cipher = _cipher()
    key, nonce = secrets.token_bytes(_SECRET_BYTES), secrets.token_bytes(_SECRET_BYTES)
    plain = canonical(label)
    commitment = digest(nonce + plain)
    counter = secrets.token_bytes(_COUNTER_BYTES)
    sealed = counter + cipher(key).encrypt(counter, plain, _bound(rig, commitment))
    seal = Seal(rig, commitment, base64.b64encode(sealed).decode("ascii"))
    return seal, Key(key.hex(), nonce.hex())


def open_seal(seal: Seal, key: Key, commitment: str | None = None) -> dict[str, Any]:
    """Return the label of a rig after a check of its seal.

    Parameters
    ----------
    seal : Seal
        The published seal.
    key : Key
        The released key.
    commitment : str, optional
        The commitment from before the diagnosis; by default the seal's own.

    Raises
    ------
    IrtError
        If the label, its encryption, the nonce, the key or the commitment was altered since the sealing; one
        line with the rig's name.
    """
    from cryptography.exceptions import InvalidTag  # noqa: PLC0415

    cipher = _cipher()
    if commitment is not None and not hmac.compare_digest(commitment, seal.commitment):
        raise IrtError(f"{seal.rig}: the seal carries another commitment than was published: it was altered")
    try:
        sealed = base64.b64decode(seal.sealed, validate=True)
        plain = cipher(bytes.fromhex(key.key)).decrypt(
            sealed[:_COUNTER_BYTES], sealed[_COUNTER_BYTES:], _bound(seal.rig, seal.commitment)
        )
    except (InvalidTag, ValueError, binascii.Error) as error:
        raise IrtError(
            f"{seal.rig}: the sealed label does not open: label, key, commitment or name was altered"
        ) from error
    if not hmac.compare_digest(digest(_bytes(seal.rig, key.nonce) + plain), seal.commitment):
        raise IrtError(f"{seal.rig}: the label does not fit its commitment: label or nonce was altered")
    label: dict[str, Any] = json.loads(plain)
    return label


def _bound(rig: str, commitment: str) -> bytes:
    """Return the data that is authenticated but not encrypted."""
    return f"{rig}\n{commitment}".encode()


def _bytes(rig: str, text: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError as error:
        raise IrtError(f"{rig}: its nonce is no hexadecimal number: it was altered") from error


def _cipher() -> Any:
    require("cryptography", "irt prove")
    from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305  # noqa: PLC0415

    return ChaCha20Poly1305
