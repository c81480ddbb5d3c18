"""Commitments: hashes that reveal nothing of a label, and fit no other one."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from irt.errors import IrtError


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


def commitment(nonce: str, what: str, content: Any) -> str:
    """Return the SHA-256 of a secret nonce, a name and content."""
    return digest(f"{nonce} {what} ".encode() + canonical(content))


def digest(data: bytes) -> str:
    """Return the SHA-256 of bytes, hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def digests(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file of a folder, by name; none if there is no folder."""
    paths = sorted(folder.iterdir()) if folder.is_dir() else []
    return {path.name: digest(path.read_bytes()) for path in paths if path.is_file()}
