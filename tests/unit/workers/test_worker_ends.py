"""Processes of work end with the one that asked for them, however that ends, and leave nothing."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from irt.errors import IrtError
from irt.workers import FAILED, Files
from irt.workers.processes import LocalWorkers, run_module

SLEEPER = (
    "import os, pathlib, time\n"
    "pathlib.Path(os.environ['HOME'], 'pid').write_text(str(os.getpid()))\n"
    "time.sleep(60)\n"
)
PARENT = (
    "import os\n"
    "from irt.workers.processes import run_module\n"
    "run_module('sleeper', {'parent': str(os.getpid()).encode()})\n"
)
#: Its second file is never written.
FILLING = (
    "import os, signal\n"
    "from irt.workers.processes import run_module\n"
    "class Files(dict):\n"
    "    def items(self):\n"
    "        yield 'a.csv', b'1'\n"
    "        os.kill(os.getpid(), signal.SIGKILL)\n"
    "run_module('sleeper', Files())\n"
)
#: A module that stops the process that asked for it, and is done.
STOPPER = (
    "import os, pathlib, signal, sys\n"
    "pathlib.Path(sys.argv[2], 'result').write_text('1')\n"
    "os.kill(int(pathlib.Path('rig/parent').read_text()), signal.SIGSTOP)\n"
    "pathlib.Path(os.environ['HOME'], 'pid').write_text(str(os.getpid()))\n"
)
#: A module that never stops making files.
WRITER = (
    "import itertools, os, pathlib, sys\n"
    "pathlib.Path(os.environ['HOME'], 'pid').write_text(str(os.getpid()))\n"
    "for number in itertools.count():\n"
    "    out = pathlib.Path(sys.argv[2], str(number % 1000))\n"
    "    out.mkdir(parents=True, exist_ok=True)\n"
    "    (out / 'a').write_text('1')\n"
)
#: A command line whose verb asks a process that sleeps.
COMMAND = (
    "import sys, irt.cli.check\n"
    "from contextlib import closing\n"
    "from irt.cli.__main__ import main\n"
    "from irt.workers.processes import LocalWorkers\n"
    "def run(args):\n"
    "    with closing(LocalWorkers(1).each('sleeper', {'a': {'a.csv': b'1'}})) as each: list(each)\n"
    "irt.cli.check.run = run\n"
    "sys.argv = ['irt', 'check', 'rig']\n"
    "sys.exit(main())\n"
)


def until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + 120.0
    while not done():
        assert time.monotonic() < end
        time.sleep(0.02)


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split(") ")[1][0] != "Z"
    except FileNotFoundError:
        return False


def environment_of(place: Path, module: str) -> dict[str, str]:
    """Write the module `sleeper`, and return an environment with it and with temporary files in ``tmp``."""
    (place / "sleeper.py").write_text(module)
    (place / "tmp").mkdir()
    paths = os.pathsep.join([str(place), *sys.path])
    return {**os.environ, "PYTHONPATH": paths, "TMPDIR": str(place / "tmp"), "HOME": str(place)}


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are looked up in /proc")
@pytest.mark.parametrize(
    ("program", "sent", "status", "said"),
    [
        (PARENT, signal.SIGKILL, -signal.SIGKILL, ""),
        (COMMAND, signal.SIGKILL, -signal.SIGKILL, ""),
        (COMMAND, signal.SIGTERM, 143, "irt: terminated\n"),
        (COMMAND, signal.SIGINT, 130, "irt: stopped\n"),
    ],
    ids=["killed function", "killed", "terminated", "interrupted"],
)
def test_a_process_ends_with_its_parent_and_leaves_no_folder(
    tmp_path: Path, program: str, sent: signal.Signals, status: int, said: str
) -> None:
    environment = environment_of(tmp_path, SLEEPER)
    pid = tmp_path / "pid"
    with subprocess.Popen(
        [sys.executable, "-c", program], env=environment, stderr=subprocess.PIPE, text=True
    ) as parent:
        until(lambda: pid.exists() and pid.read_text() != "")
        parent.send_signal(sent)
        assert parent.communicate() == (None, said)
    assert parent.returncode == status
    until(lambda: not list((tmp_path / "tmp").iterdir()))
    assert not alive(int(pid.read_text()))


def test_a_parent_killed_while_it_writes_the_input_leaves_no_folder(tmp_path: Path) -> None:
    environment = environment_of(tmp_path, SLEEPER)
    parent = subprocess.run([sys.executable, "-c", FILLING], env=environment, check=False)
    assert parent.returncode == -signal.SIGKILL
    until(lambda: not list((tmp_path / "tmp").iterdir()))
    assert not (tmp_path / "pid").exists()


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are looked up in /proc")
@pytest.mark.parametrize("module", [STOPPER, WRITER], ids=["done", "writing"])
def test_a_parent_killed_while_its_process_is_done_or_writes_leaves_no_folder(
    tmp_path: Path, module: str
) -> None:
    environment = environment_of(tmp_path, module)
    pid = tmp_path / "pid"
    with subprocess.Popen([sys.executable, "-c", PARENT], env=environment) as parent:
        until(lambda: pid.exists() and pid.read_text() != "")
        # Long enough for the end of an interpreter.
        time.sleep(0.2)
        assert list((tmp_path / "tmp").iterdir())
        parent.kill()
    until(lambda: not list((tmp_path / "tmp").iterdir()))
    assert not alive(int(pid.read_text()))


def test_a_module_that_is_killed_or_exits_with_words_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    for name, program, said in (
        ("killed", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "ended with exit status 137"),
        ("refused", "import sys; sys.exit('no room')", "no room"),
        ("silent", "raise SystemExit(3)", "ended with exit status 3"),
        ("broken", "1 / 0", "ZeroDivisionError: division by zero"),
        ("ended", "import os; os._exit(0)", None),
        ("done", "raise SystemExit", None),
    ):
        (tmp_path / f"module_{name}.py").write_text(program)
        files = run_module(f"module_{name}", {})
        assert files == ({FAILED: json.dumps({"error": said}).encode()} if said else {})
    assert not list((tmp_path / "tmp").iterdir())


def test_a_module_that_takes_too_long_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sleeper.py").write_text(SLEEPER)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    monkeypatch.setattr("irt.workers.processes.PATIENCE_S", 0.1)
    assert run_module("sleeper", {}) == {FAILED: b'{"error": "took longer than 0.1 s"}'}
    assert not list((tmp_path / "tmp").iterdir())


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are looked up in /proc")
def test_ctrl_c_between_two_starts_ends_what_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sleeper.py").write_text(SLEEPER + "pathlib.Path(os.environ['HOME'], 'awake').touch()\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    pid = tmp_path / "pid"

    class Stopped(dict[str, Files]):
        def items(self):
            yield "first", {"a.csv": b"1"}
            until(lambda: pid.exists() and pid.read_text() != "")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(LocalWorkers(2).each("sleeper", Stopped()))
    assert not alive(int(pid.read_text()))
    assert not (tmp_path / "awake").exists()


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(IrtError, match=r"cannot be written: .*; TMPDIR names another place"):
        run_module("irt.tuning.shards", {"x" * 300: b"1"})
    assert not list(tmp_path.iterdir())
