"""`irt export` as a user types it."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from irt.model import Effect, Model, Parameter, save_model
from irt.rig import PARAMETERS, RANGES, Board, Marble

VALUES = (0.07, 0.06, 0.0005, 24.0, 1.05)
MODEL = Model(
    board=Board(),
    marble=Marble(),
    start="rest",
    ranges=dict(RANGES),
    parameters={name: Parameter(value) for name, value in zip(PARAMETERS, VALUES, strict=True)},
    effects=(Effect("delay", {"delay_s": 0.1}), Effect("dead_band", {"half_width_rad": 0.01})),
)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    save_model(tmp_path / "model.toml", MODEL)
    return tmp_path / "model.toml"


def test_writes_mjcf_and_says_what_it_lacks(irt, tmp_path: Path, model: Path) -> None:
    out = tmp_path / "board.xml"
    ran = irt("export", model, "--to", "mjcf", "--out", out)
    assert ran.status == 0, ran.err
    assert f"wrote {out}" in ran.out
    assert "warning: dead_band (half_width_rad 0.01) is left out" in ran.err
    assert ET.parse(out).getroot().tag == "mujoco"


def test_writes_to_standard_output(irt, model: Path) -> None:
    ran = irt("export", model, "--to", "json")
    assert ran.status == 0, ran.err
    assert json.loads(ran.out)["effects"][0]["name"] == "delay"


def test_wrong_usage_is_2(irt, model: Path) -> None:
    for words in (("export", model), ("export", model, "--to", "urdf"), ("export", "--to", "json")):
        ran = irt(*words)
        assert ran.status == 2
        assert "usage" in ran.err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda path: path.write_text("[parameters]\n"), "is missing"),
        (lambda path: path.unlink(), "no such file"),
    ],
    ids=["no parameters", "no file"],
)
def test_a_model_that_is_none_is_one_line(irt, model: Path, change, message: str) -> None:
    change(model)
    ran = irt("export", model, "--to", "mjcf")
    assert ran.status == 1
    assert ran.err.startswith("irt: ")
    assert message in ran.err
    assert len(ran.err.splitlines()) == 1


def test_a_folder_that_is_not_there_is_one_line(irt, tmp_path: Path, model: Path) -> None:
    ran = irt("export", model, "--to", "json", "--out", tmp_path / "none" / "model.json")
    assert ran.status == 1
    assert "make it first" in ran.err
