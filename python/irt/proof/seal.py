"""Seals: encrypted labels of hidden physics, with commitments that reveal any change.

The commitment is the SHA-256 of the label and a secret nonce of 32 bytes in it. It does not reveal the label
and fits no other one. The label is encrypted with ChaCha20-Poly1305 (RFC 8439) under the key of the proof.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from irt.errors import IrtError
from irt.extras import require

_COUNTER_BYTES = 12


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
    """Return the SHA-256 of each file of a folder, by name; none if there is no folder."""
    paths = sorted(folder.iterdir()) if folder.is_dir() else []
    return {path.name: digest(path.read_bytes()) for path in paths if path.is_file()}


def close(rig: str, label: Mapping[str, Any], key: str) -> dict[str, str]:
    """Return the seal of a rig: its name, the commitment to its label, and the label, encrypted.

    Raises
    ------
    IrtError
        If the label cannot be written as JSON, or the package that encrypts is missing.
    """
    plain = canonical({"nonce": secrets.token_hex(32), "rig": rig, **label})
    counter = secrets.token_bytes(_COUNTER_BYTES)
    sealed = counter + _cipher(key).encrypt(counter, plain, rig.encode())
    return {"rig": rig, "commitment": digest(plain), "sealed": sealed.hex()}


def open_seal(rig: str, seal: Mapping[str, str], key: str, commitment: str) -> dict[str, Any]:
    """Return the label of a rig after a check of its seal against the published commitment.

    Raises
    ------
    IrtError
        If the seal, the key or the commitment was altered since the sealing; one line with the rig's name.
    """
    from cryptography.exceptions import InvalidTag  # noqa: PLC0415

    try:
        sealed = bytes.fromhex(seal["sealed"])
        plain = _cipher(key).decrypt(sealed[:_COUNTER_BYTES], sealed[_COUNTER_BYTES:], rig.encode())
    except (InvalidTag, ValueError, KeyError) as error:
        raise IrtError(f"{rig}: the sealed label does not open: label, key or name was altered") from error
    if digest(plain) != commitment:
        raise IrtError(f"{rig}: the label does not fit its published commitment: one of them was altered")
    label: dict[str, Any] = json.loads(plain)
    return label


def _cipher(key: str) -> Any:
    require("cryptography", "irt prove")
    from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305  # noqa: PLC0415

    return ChaCha20Poly1305(bytes.fromhex(key))
