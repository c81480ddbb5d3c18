"""A wrong input ends an example in one line, as it ends `irt`."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from irt.errors import IrtError

pytest.importorskip("gymnasium")

import mpc

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
#: Hides a package as if it were not installed.
WITHOUT = """\
import importlib.util, runpy, sys
find, hidden = importlib.util.find_spec, sys.argv[1]
importlib.util.find_spec = lambda name, *rest: None if name == hidden else find(name, *rest)
sys.argv = sys.argv[2:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def ran(*words, **environment):
    """Return the exit status and the lines on standard error of a Python process."""
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stderr.splitlines()


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (("--model", "nowhere.toml"), 1, "mpc.py: nowhere.toml: no such file"),
        (("--seed", "-1"), 2, "--seed: expected a whole number from 0 on, found -1"),
    ],
)
def test_a_wrong_input_is_one_line(words, status, said):
    code, lines = ran(EXAMPLES / "mpc.py", *words)
    assert code == status
    assert said in lines[-1]
    assert len(lines) == 1 or status == 2
    assert not any("Traceback" in line for line in lines)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--model", str(EXAMPLES)), "is a folder, where a file was expected"),
        (("--maze", "cyberrunner-esay"), 'did you mean "cyberrunner-easy"?'),
        (("--tilt", "nan"), "tilt_limit_rad: expected a number"),
    ],
)
def test_a_wrong_input_says_what_is_wrong(monkeypatch, words, said):
    monkeypatch.setattr("sys.argv", ["mpc.py", *words])
    with pytest.raises(IrtError, match=re.escape(said)):
        mpc.main()


def test_the_traceback_is_there_for_whoever_wants_it():
    code, lines = ran(EXAMPLES / "mpc.py", "--model", "nowhere.toml", IRT_TRACEBACK="1")
    assert code == 1
    assert lines[0].startswith("Traceback")


@pytest.mark.parametrize(
    ("example", "package", "extra"),
    [("mpc.py", "gymnasium", "gym"), ("ppo.py", "gymnasium", "gym"), ("ppo.py", "torch", "train")],
)
def test_a_missing_extra_is_one_line(example, package, extra):
    code, (line,) = ran("-c", WITHOUT, package, EXAMPLES / example)
    assert code == 1
    assert line.startswith(f"{example}: ")
    assert line.endswith(f"pip install 'labsim-irt[{extra}]'")
