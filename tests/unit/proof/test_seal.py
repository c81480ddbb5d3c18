"""A seal that was touched does not open, and says of which rig it is."""

from __future__ import annotations

import base64
from dataclasses import replace

import pytest

from irt.errors import IrtError
from irt.proof.seal import Key, canonical, close, open_seal

LABEL = {"kind": "delay", "truth": {"delay_s": 0.1}, "tests": [1.5, "text"]}


def test_what_was_sealed_comes_out() -> None:
    seal, key = close("rig-0001", LABEL)
    assert open_seal(seal, key, seal.commitment) == LABEL
    assert "delay" not in f"{seal}"


def test_equal_labels_look_different() -> None:
    one, other = close("rig-0001", LABEL)[0], close("rig-0001", LABEL)[0]
    assert one.commitment != other.commitment
    assert one.sealed != other.sealed


@pytest.mark.parametrize("place", [0, 20, -1], ids=["counter", "label", "tag"])
def test_altered_ciphertext_is_caught(place: int) -> None:
    seal, key = close("rig-0001", LABEL)
    altered = bytearray(base64.b64decode(seal.sealed))
    altered[place] ^= 1
    sealed = base64.b64encode(bytes(altered)).decode()
    with pytest.raises(IrtError, match=r"^rig-0001: the sealed label does not open"):
        open_seal(replace(seal, sealed=sealed), key)


@pytest.mark.parametrize("sealed", ["", "AAAA", "no base64!"])
def test_what_is_no_ciphertext_is_caught(sealed: str) -> None:
    seal, key = close("rig-0001", LABEL)
    with pytest.raises(IrtError, match=r"^rig-0001: "):
        open_seal(replace(seal, sealed=sealed), key)


def test_another_label_under_the_same_key_is_caught() -> None:
    """Whoever has the keys could encrypt another label; the commitment stands against it."""
    seal, key = close("rig-0001", LABEL)
    forged, forged_key = close("rig-0001", {**LABEL, "kind": "lag"})
    with pytest.raises(IrtError, match=r"^rig-0001: the seal carries another commitment than was published"):
        open_seal(forged, forged_key, seal.commitment)
    with pytest.raises(IrtError, match=r"^rig-0001: the sealed label does not open"):
        open_seal(replace(forged, commitment=seal.commitment), forged_key, seal.commitment)
    assert open_seal(seal, key, seal.commitment) == LABEL


def test_altered_nonce_is_caught() -> None:
    seal, key = close("rig-0001", LABEL)
    with pytest.raises(IrtError, match=r"^rig-0001: the label does not fit its commitment"):
        open_seal(seal, replace(key, nonce=Key("", "").nonce + "00" * 32))
    with pytest.raises(IrtError, match=r"^rig-0001: its nonce"):
        open_seal(seal, replace(key, nonce="zz"))


@pytest.mark.parametrize("key", ["00" * 32, "00", "zz"])
def test_altered_key_is_caught(key: str) -> None:
    seal, right = close("rig-0001", LABEL)
    with pytest.raises(IrtError, match=r"^rig-0001: "):
        open_seal(seal, replace(right, key=key))


def test_a_seal_belongs_to_one_rig() -> None:
    seal, key = close("rig-0001", LABEL)
    with pytest.raises(IrtError, match=r"^rig-0002: "):
        open_seal(replace(seal, rig="rig-0002"), key)


def test_bytes_depend_on_the_content_alone() -> None:
    assert canonical({"b": 0.1, "a": [1, None]}) == canonical({"a": [1, None], "b": 0.1})
    assert canonical({"b": 0.1, "a": "ü"}) == b'{"a":"\\u00fc","b":0.1}'
    with pytest.raises(IrtError, match="cannot be written as JSON"):
        canonical({"a": float("nan")})
