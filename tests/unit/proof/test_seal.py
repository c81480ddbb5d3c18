"""A seal that was touched does not open, and says of which rig it is."""

from __future__ import annotations

import pytest

from irt.errors import IrtError
from irt.proof.seal import canonical, close, open_seal

LABEL = {"kind": "delay", "truth": {"delay_s": 0.1}, "tests": [1.5, "text"]}
KEY = "5e" * 32


def test_what_was_sealed_comes_out() -> None:
    seal = close("rig-0001", LABEL, KEY)
    opened = open_seal("rig-0001", seal, KEY, seal["commitment"])
    assert {name: opened[name] for name in LABEL} == LABEL
    assert "delay" not in f"{seal}"
    assert b"delay" not in bytes.fromhex(seal["sealed"])


def test_equal_labels_look_different() -> None:
    one, other = close("rig-0001", LABEL, KEY), close("rig-0001", LABEL, KEY)
    assert one["commitment"] != other["commitment"]
    assert one["sealed"] != other["sealed"]


@pytest.mark.parametrize("place", [0, 20, -1], ids=["counter", "label", "tag"])
def test_altered_ciphertext_is_caught(place: int) -> None:
    seal = close("rig-0001", LABEL, KEY)
    altered = bytearray(bytes.fromhex(seal["sealed"]))
    altered[place] ^= 1
    with pytest.raises(IrtError, match=r"^rig-0001: the sealed label does not open"):
        open_seal("rig-0001", {**seal, "sealed": altered.hex()}, KEY, seal["commitment"])


@pytest.mark.parametrize("changed", [{"sealed": ""}, {"sealed": "AAAA"}, {"sealed": "no number!"}])
def test_what_is_no_ciphertext_is_caught(changed: dict[str, str]) -> None:
    seal = close("rig-0001", LABEL, KEY)
    with pytest.raises(IrtError, match=r"^rig-0001: the sealed label does not open"):
        open_seal("rig-0001", {**seal, **changed}, KEY, seal["commitment"])


def test_another_label_under_the_same_key_is_caught() -> None:
    """Whoever has the key could encrypt another label; the commitment stands against it."""
    seal, forged = close("rig-0001", LABEL, KEY), close("rig-0001", {**LABEL, "kind": "lag"}, KEY)
    with pytest.raises(IrtError, match=r"^rig-0001: the label does not fit its published commitment"):
        open_seal("rig-0001", forged, KEY, seal["commitment"])


@pytest.mark.parametrize("key", ["00" * 32, "00", "zz"])
def test_altered_key_is_caught(key: str) -> None:
    seal = close("rig-0001", LABEL, KEY)
    with pytest.raises(IrtError, match=r"^rig-0001: "):
        open_seal("rig-0001", seal, key, seal["commitment"])


def test_a_seal_belongs_to_one_rig() -> None:
    seal = close("rig-0001", LABEL, KEY)
    with pytest.raises(IrtError, match=r"^rig-0002: "):
        open_seal("rig-0002", seal, KEY, seal["commitment"])


def test_bytes_depend_on_the_content_alone() -> None:
    assert canonical({"b": 0.1, "a": [1, None]}) == canonical({"a": [1, None], "b": 0.1})
    assert canonical({"b": 0.1, "a": "ü"}) == b'{"a":"\\u00fc","b":0.1}'
    with pytest.raises(IrtError, match="cannot be written as JSON"):
        canonical({"a": float("nan")})
