"""The page of the proof by transfer: planted differences come back with their intervals."""

import json

import numpy as np
import pytest

import irt
from irt.environment.vector import default_model
from transfer_page import TITLES, _interval, write_page

ARMS = list(TITLES)


def run(ended="arrived", progress=1.0, seconds=10.0):
    return {"ended": ended, "progress": progress, "seconds": seconds, "beside_mm": 4.0}


@pytest.fixture
def folders(tmp_path):
    """Rigs on which the diagnosis arrives always, the tuned model never, all others with every other seed."""
    found = []
    for number in range(6):
        folder = tmp_path / f"rig-{number}"
        folder.mkdir()
        label = {"effects": [{"name": "delay", "delay_s": 0.2}]}
        (folder / "label.json").write_text(json.dumps(label))
        (folder / "errors.json").write_text(json.dumps(dict.fromkeys(ARMS, 0.01)))
        irt.save_model(folder / "diagnosed.toml", default_model())
        for arm in ARMS:
            runs = [run() if seed % 2 else run("stuck", 0.5) for seed in range(4)]
            if arm in ("diagnosed", "tuned"):
                runs = [run(seconds=8.0) if arm == "diagnosed" else run("fell", 0.25)] * 4
            (folder / f"bare-{arm}.json").write_text(json.dumps(runs))
        found.append(folder)
    return found


def test_planted_differences_are_on_the_page(folders, tmp_path):
    write_page(tmp_path / "page.md", {"bare": folders}, ARMS, "Does it pay?\n\nHow it was done.\n")
    page = (tmp_path / "page.md").read_text()
    assert page.index("Does it pay?") < page.index("| Bare board, planned, 6 rigs |") < page.index("How it")
    assert "| Bare board, planned, 6 rigs | 0 %, 4.0 mm | 50 %, 4.0 mm |" in page
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith(f"| {TITLES['tuned']}")]
    overall, beside = rows
    assert overall[1:3] == ["0.0 (0.0 to 0.0)", "25.0 (25.0 to 25.0)"]
    assert overall[3] == "none"
    assert overall[5:] == ["24 of 24", "0 of 24 |"]
    assert beside[1:3] == ["+100.0 (+100.0 to +100.0)", "+75.0 (+75.0 to +75.0)"]
    assert "| delay 0.2 s | nothing | 1, 1, 1, 1, 1 | 0, 2, 2, 4, 2 |" in page
    # With a delay tuned, half of the runs arrive, two seconds later.
    (late,) = [line for line in page.splitlines() if line.startswith(f"| {TITLES['delayed']} | +")]
    assert "| +50.0 (" in late
    assert late.endswith("| -2.0 (-2.0 to -2.0) | +0.0 (+0.0 to +0.0) |")


def test_an_interval_is_as_wide_as_rigs_differ():
    values = np.repeat(np.random.default_rng(0).normal(size=(30, 1)), 5, axis=1)
    low, high = (float(end) for end in _interval(values).split("(")[1].rstrip(")").split(" to "))
    # Seeds that all say the same count as one run.
    assert high - low == pytest.approx(2 * 1.96 * values[:, 0].std() / 30**0.5, rel=0.25)
