"""The examples of README.md work on the example rig."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "python" / "irt" / "data" / "demo-rig"
README = (ROOT / "README.md").read_text(encoding="utf-8")


def code(language: str, holding: str) -> str:
    """Return the one code block of a language that holds the given text."""
    blocks = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
    (block,) = [block for block in blocks if holding in block]
    return str(block)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the rig that the examples name."""
    shutil.copytree(RIG, tmp_path / "my-rig")
    return tmp_path


def run(command: list[str], folder: Path) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    ran = subprocess.run(
        command, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


@pytest.mark.slow
def test_commands(irt, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    # Half of the runs take half of the time.
    for number in (4, 5, 6):
        (folder / "my-rig" / f"run-{number}.csv").unlink()
    lines = [shlex.split(line, comments=True) for line in code("sh", "irt diagnose my-rig").splitlines()]
    for name, *words in lines:
        if name == "irt":
            done = irt(*words)
            # What MuJoCo does not do as the model has it is a warning.
            may_warn = words[0] == "export"
            assert done.status == 0, words
            assert all(may_warn and line.startswith("warning: ") for line in done.err.splitlines()), words

    assert len(list((folder / "drive").iterdir())) == 6
    assert (folder / "diagnosed" / "report.html").exists()
    assert len((folder / "predicted.csv").read_text().splitlines()) == 161
    assert (folder / "suggest.csv").exists()


@pytest.mark.slow
def test_python(folder: Path) -> None:
    printed = run([sys.executable, "-c", code("python", "import irt")], folder)
    assert printed.splitlines()[-1] == "(100, 2)"


def test_recording(folder: Path) -> None:
    (folder / "my-rig" / "run-7.csv").write_text(code("text", "knob_x_rad"))
    script = "import irt; print(irt.load_rig('my-rig').recordings[-1].stamps)"
    assert run([sys.executable, "-c", script], folder) == "[0.   0.05]\n"


def test_rig_file(folder: Path) -> None:
    (folder / "my-rig" / "rig.toml").write_text(code("toml", "[board]"))
    script = "import irt; rig = irt.load_rig('my-rig'); print(rig.board.edge_x_m, rig.marble.radius_m)"
    assert run([sys.executable, "-c", script], folder) == "0.276 0.00685\n"


def test_tables_are_short() -> None:
    """Long tables belong to docs/: the README is one screen to the first result."""
    rows = [len(table.splitlines()) - 2 for table in re.findall(r"(?m)(?:^\|.*\n)+", README)]
    assert max(rows) <= 8
