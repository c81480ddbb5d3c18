"""What README.md shows works as it is written there, on the rig that is shipped."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "python" / "irt" / "data" / "labyrinth"
README = (ROOT / "README.md").read_text(encoding="utf-8")


def code(language: str, holding: str) -> str:
    """Return the one code block of a language that holds the given text."""
    blocks = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
    (block,) = [block for block in blocks if holding in block]
    return str(block)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with what the examples name: a rig, and commands."""
    shutil.copytree(RIG, tmp_path / "my-rig")
    shutil.copy(RIG / "run-1.csv", tmp_path / "knobs.csv")
    return tmp_path


def run(command: list[str], folder: Path) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "IRT_CACHE": str(folder / "cache")}
    ran = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_commands(folder: Path) -> None:
    for line in code("sh", "irt tune my-rig --out tuned").splitlines():
        if line.startswith("irt "):
            run(["sh", "-c", line], folder)

    assert (folder / "tuned" / "model.toml").exists()
    assert len((folder / "predicted.csv").read_text().splitlines()) == 101


def test_python(folder: Path) -> None:
    said = run([sys.executable, "-c", code("python", "import irt") + "print(marble.shape)"], folder)
    assert said.splitlines()[-1] == "(1, 100, 2)"


def test_rig_file(folder: Path) -> None:
    (folder / "my-rig" / "rig.toml").write_text(code("toml", "[board]"))
    script = "import irt; rig = irt.load_rig('my-rig'); print(rig.board.edge_x_m, rig.ranges['time_scale'])"
    assert run([sys.executable, "-c", script], folder) == "0.276 (0.0, 50.0)\n"
