"""The docs site: every page is reached from the menu, and every public name is on the page of the API."""

import json
import re
import tomllib
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irt
from irt.cli.demo import data
from irt.diagnosis.result import Share
from irt.posterior import Component, Spread

ROOT = Path(__file__).resolve().parents[2]


def pages(entry: object) -> list[str]:
    """Return the pages of a menu entry and of all below it."""
    if isinstance(entry, dict | list):
        return [page for one in (entry.values() if isinstance(entry, dict) else entry) for page in pages(one)]
    return [str(entry)]


def test_menu_holds_every_page_once() -> None:
    menu = tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))["project"]["nav"]
    assert sorted(pages(menu)) == sorted(page.name for page in (ROOT / "docs").glob("*.md"))


def test_api_page_holds_every_public_name_once() -> None:
    api = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^::: irt\.(\w+)$", api, re.MULTILINE)) == sorted(irt.__all__)


def run_blocks(page: str) -> dict[str, Any]:
    """Run the Python of a page of the docs in one namespace, and return that."""
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL):
        exec(block, names)
    return names


@pytest.fixture
def diagnosed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder that the pages name, in a working directory of its own."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "diagnosed"
    folder.mkdir()
    return folder


def test_batches_of_a_model_can_be_rolled_out_as_the_docs_say(diagnosed: Path) -> None:
    effects = [irt.Effect("backlash", {"width_x_rad": 0.04, "width_y_rad": 0.06})]
    rig = irt.load_rig(data("demo-rig"))
    model = irt.Model.from_rig(rig, [0.09, 0.098, 3e-4, 12.0, 1.03], effects=effects)
    gear = Spread(0.09, 0.0, np.inf, (0.005,), (0.0,))
    kept = replace(model, posterior=(Component(1.0, ("backlash",), {"gear_x": gear}),))
    irt.save_model(diagnosed / "model.toml", kept)
    names = run_blocks("train.md")
    assert names["marble"].shape == (100, 120, 2)
    values = np.array([one.values for one in names["drawn"]])
    assert values[:, 0].std() == pytest.approx(0.005, rel=0.3)
    assert np.ptp(values[:, 1:], axis=0).max() == 0.0
    assert len(run_blocks("use.md")["paths"]) == 200


def test_numbers_of_a_diagnosis_can_be_read_as_the_docs_say(
    diagnosed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit = {"base_heldout_mae": 0.04, "final_heldout_mae": 0.002}
    budget = [Share("lag", 0.4, 1.0), Share("lag", 0.98, None), Share("tracker", 0.02, None)]
    content = {"summary": "Lag was left out.", "fit": fit, "budget": [asdict(one) for one in budget]}
    (diagnosed / "diagnosis.json").write_text(json.dumps(content))
    run_blocks("diagnosis.md")
    assert capsys.readouterr().out.splitlines() == [
        "Lag was left out.",
        "explained: 95 % of the error on runs held out",
        "lag: 98.0 % of the squared error",
        "tracker: 2.0 % of the squared error",
    ]


def test_the_architecture_names_every_file_of_the_diagnosis() -> None:
    (part,) = re.findall(
        r"^## A diagnosis\n(.*?)^## ", (ROOT / "ARCHITECTURE.md").read_text(), re.DOTALL | re.MULTILINE
    )
    files = {path.name for path in (ROOT / "python/irt/diagnosis").glob("*.py")}
    assert set(re.findall(r"`(\w+\.py)`", part)) == files - {"__init__.py"}
