"""A commitment fits one label of one rig under one nonce."""

from __future__ import annotations

import hashlib

import pytest

from irt.errors import IrtError
from irt.proof.seal import canonical, commitment

LABEL = {"kind": "delay", "truth": {"delay_s": 0.1}, "tests": [1.5, "text"]}
NONCE = "5e" * 32


def test_a_commitment_can_be_made_again_by_hand() -> None:
    plain = NONCE + ' rig-0001 {"kind":"delay","tests":[1.5,"text"],"truth":{"delay_s":0.1}}'
    assert commitment(NONCE, "rig-0001", LABEL) == hashlib.sha256(plain.encode()).hexdigest()


@pytest.mark.parametrize(
    ("nonce", "rig", "label"),
    [
        ("00" * 32, "rig-0001", LABEL),
        (NONCE, "rig-0002", LABEL),
        (NONCE, "rig-0001", {**LABEL, "kind": "lag"}),
    ],
    ids=["nonce", "rig", "label"],
)
def test_another_nonce_rig_or_label_gives_another_commitment(nonce: str, rig: str, label: dict) -> None:
    assert commitment(nonce, rig, label) != commitment(NONCE, "rig-0001", LABEL)


def test_bytes_depend_on_the_content_alone() -> None:
    assert canonical({"b": 0.1, "a": [1, None]}) == canonical({"a": [1, None], "b": 0.1})
    assert canonical({"b": 0.1, "a": "ü"}) == b'{"a":"\\u00fc","b":0.1}'
    with pytest.raises(IrtError, match="cannot be written as JSON"):
        canonical({"a": float("nan")})
