"""The notebook of the docs runs from top to bottom, in one namespace, as a kernel would run it."""

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "first-rig.ipynb"
CELLS = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]


@pytest.mark.slow
def test_every_cell_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plt.switch_backend("agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in CELLS:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    plt.close("all")

    assert [effect.name for effect in names["found"].effects] == ["backlash"]
    assert (tmp_path / "suggest.csv").exists()


def test_outputs_are_left_out():
    """They change with every version and hide what a change of the notebook is."""
    assert all(not cell["outputs"] for cell in CELLS if cell["cell_type"] == "code")
