"""Optional packages: the base works without them, and the rest says in one line which extra adds them."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from irt.engine import rollouts
from irt.errors import IrtError
from irt.extras import OPTIONAL, require

ROOT = Path(__file__).resolve().parents[2]
#: Runs command lines in one interpreter from which the optional packages are hidden.
HIDDEN = """
import contextlib, io, json, sys
from importlib.machinery import PathFinder

hidden, *lines = json.loads(sys.argv[1])

class WithoutExtras(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in hidden else super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = WithoutExtras
from irt.cli.__main__ import main
answers = []
for line in lines:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as err:
        status = main(line)
    answers.append([status, err.getvalue()])
print(json.dumps(answers))
"""


def run_hidden(*lines):
    """Return (status, standard error) of each command line, with every optional package hidden."""
    words = json.dumps([[*OPTIONAL, "mcap"], *([str(word) for word in line] for line in lines)])
    ran = subprocess.run([sys.executable, "-c", HIDDEN, words], capture_output=True, text=True, check=True)
    return json.loads(ran.stdout)


def test_every_optional_package_is_in_its_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    distributions = {"cv2": "opencv-python-headless", "mcap_ros2": "mcap-ros2-support"}
    for package, (_, extra) in OPTIONAL.items():
        found = [re.split(r"[\[<>=; ]", one)[0] for one in project["optional-dependencies"][extra]]
        assert distributions.get(package, package) in found


def test_a_hidden_package_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(IrtError, match=r"^irt track needs OpenCV: pip install 'labsim-irt\[track\]'$"):
        require("cv2", "irt track")


@pytest.mark.slow
def test_the_base_tunes_without_any_extra(tmp_path):
    rig = ROOT / "python" / "irt" / "data" / "labyrinth"
    answers = run_hidden(
        ["tune", rig, "--method", "irt", "--starts", 1, "--iterations", 3, "--out", tmp_path / "irt"],
        ["tune", rig, "--method", "irt+", "--rollouts", 10, "--out", tmp_path / "irt+"],
        ["tune", rig, "--method", "cma-es", "--starts", 1, "--rollouts", 10, "--out", tmp_path / "cma-es"],
        ["check", rig],
    )
    assert answers == [[0, ""]] * 4
    assert (tmp_path / "irt+" / "model.toml").exists()


@pytest.mark.slow
def test_what_needs_an_extra_says_so_in_one_line(tmp_path, write_rig, wave):
    bag = tmp_path / "run.mcap"
    bag.write_bytes(b"\x89MCAP0\r\n")
    pictures = tmp_path / "film.mp4"
    pictures.write_bytes(b"no film")
    marble = rollouts([[0.05, 0.05, 1e-4, 20.0, 1.0]], wave)[0]
    own = write_rig({"run": (wave, marble)}, folder="own")
    lines = [
        ("train", ["pretrain", "--pairs", 10, "--out", tmp_path / "net"]),
        ("train", ["tune", own, "--method", "irt", "--out", tmp_path / "tuned"]),
        ("track", ["track", pictures, "--out", tmp_path / "tracked"]),
        ("ros", ["import", bag, "--out", tmp_path / "imported"]),
        ("prove", ["prove", "--out", tmp_path / "proof"]),
    ]
    answers = run_hidden(*(line for _, line in lines))
    for (extra, _), (status, err) in zip(lines, answers, strict=True):
        assert status == 1
        assert err.endswith(f"pip install 'labsim-irt[{extra}]'\n")
        assert err.count("\n") == 1
    assert answers[1][1].startswith("irt: --method irt trains a network for this rig's drive, which needs ")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film.mp4", "own", "run.mcap"]
