from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from irt.cli.__main__ import VERBS
from irt.errors import IrtError
from irt.recording import save_recording

COMMAND = [sys.executable, "-m", "irt"]
UNIX = pytest.mark.skipif(os.name == "nt", reason="signals and devices of Unix")
PARAMETERS = (
    "gear_x = 0.07\ngear_y = 0.06\nrolling_friction = 0.0005\ntime_scale = 24\nobservation_scale = 1\n"
)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "model.toml"
    path.write_text(f"[parameters]\n{PARAMETERS}")
    return path


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch):
    """Make `irt simulate` raise; return a command line for it."""

    def fail_with(error: BaseException) -> tuple[str, ...]:
        def run(_: object) -> None:
            raise error

        monkeypatch.setattr("irt.cli.simulate.run", run)
        return ("simulate", "model.toml", "--commands", "run.csv")

    return fail_with


def test_help_lists_the_verbs_in_their_order(irt) -> None:
    status, out, err = irt("--help")
    assert (status, err) == (0, "")
    places = [out.index(f"\n    {verb} ") for verb in VERBS]
    assert places == sorted(places)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example(irt, verb: str) -> None:
    status, out, err = irt(verb, "--help")
    assert (status, err) == (0, "")
    assert out.startswith(f"usage: irt {verb} ")
    assert re.search(rf"^examples?:\n  irt {verb}\b", out, re.M)


@pytest.mark.parametrize(
    "words",
    [(), ("simulte",), ("simulate",), ("simulate", "model.toml", "--command", "a.csv"), ("--nonsense",)],
    ids=["no verb", "unknown verb", "argument missing", "abbreviated option", "unknown option"],
)
def test_wrong_usage(irt, words: tuple[str, ...]) -> None:
    status, out, err = irt(*words)
    assert (status, out) == (2, "")
    assert err.startswith("usage: irt")


@pytest.mark.parametrize(
    ("words", "usage", "error"),
    [
        (("simulte", "model.toml"), "irt [-h]", "invalid choice: 'simulte' .*; did you mean simulate?"),
        (("check", "rig", "--jsn"), "irt check [-h]", "unrecognized arguments: --jsn; did you mean --json?"),
        (("export", "m.toml", "--to", "mjfc"), "irt export [-h]", "'mjfc' .*; did you mean mjcf?"),
        (("check", "rig", "another"), "irt check [-h]", "unrecognized arguments: another"),
    ],
)
def test_the_nearest_word_is_suggested(irt, words: tuple[str, ...], usage: str, error: str) -> None:
    status, out, err = irt(*words)
    assert (status, out) == (2, "")
    assert err.startswith(f"usage: {usage}")
    assert re.search(f"{error.replace('?', '[?]')}$", err.rstrip())


def test_without_words_the_help_is_shown(irt) -> None:
    status, out, err = irt()
    assert (status, out) == (2, "")
    assert err == irt("--help").out


def test_version(irt) -> None:
    import irt as package  # noqa: PLC0415

    assert irt("--version") == (0, f"irt {package.__version__}\n", "")


def test_what_cannot_be_done_is_one_line(irt, failing) -> None:
    assert irt(*failing(IrtError("run.csv, line 3: no"))) == (1, "", "irt: run.csv, line 3: no\n")


def test_an_unexpected_error_is_one_line_too(irt, failing) -> None:
    status, out, err = irt(*failing(TypeError("two\nlines")))
    assert (status, out) == (1, "")
    assert err.startswith("irt: unexpected TypeError: two lines (a fault of irt; ")
    assert err.count("\n") == 1


def test_traceback_on_demand(irt, failing, monkeypatch) -> None:
    words = failing(TypeError("x"))
    for asked in (("--traceback", *words), (*words, "--traceback")):
        status, _, err = irt(*asked)
        assert status == 1
        assert "Traceback (most recent call last)" in err
    monkeypatch.setenv("IRT_TRACEBACK", "1")
    assert "Traceback" in irt(*words).err
    monkeypatch.setenv("IRT_TRACEBACK", "0")
    assert "Traceback" not in irt(*words).err


def test_stopping_is_one_line(irt, failing) -> None:
    assert irt(*failing(KeyboardInterrupt())) == (130, "", "irt: stopped\n")


@UNIX
def test_ctrl_c_stops_a_process(tmp_path: Path, model: Path) -> None:
    pipe = tmp_path / "run.csv"
    os.mkfifo(pipe)
    command = [*COMMAND, "simulate", model, "--commands", pipe]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    with pipe.open("w"):  # returns once the process has opened the other end, and waits there for lines
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    assert (process.returncode, out, err) == (130, "", "irt: stopped\n")


@pytest.fixture
def long_commands(tmp_path: Path) -> Path:
    """More rows than a pipe holds."""
    path = tmp_path / "long.csv"
    save_recording(path, np.zeros((5000, 2)), np.zeros((5000, 2)))
    return path


@UNIX
def test_a_reader_that_has_enough_is_no_error(model: Path, long_commands: Path) -> None:
    with subprocess.Popen(
        [*COMMAND, "simulate", model, "--commands", long_commands],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=120) == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_behind_standard_output(model: Path, long_commands: Path) -> None:
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run(
            [*COMMAND, "simulate", model, "--commands", long_commands],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (ran.returncode, ran.stderr) == (1, "irt: output: No space left on device\n")


def test_help_loads_no_arrays() -> None:
    script = (
        "import sys; from irt.cli.__main__ import main\ntry: main(['--help'])\n"
        "except SystemExit: pass\nassert 'numpy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], capture_output=True, check=True)
