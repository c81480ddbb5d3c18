"""Processes of work end with the one that asked for them, however that ends, and leave nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from irt.errors import IrtError
from irt.workers import Files
from irt.workers.processes import LocalWorkers, run_module

SLEEPER = (
    "import os, pathlib, time\n"
    "pathlib.Path(os.environ['HOME'], 'pid').write_text(str(os.getpid()))\n"
    "time.sleep(60)\n"
)
PARENT = "from irt.workers.processes import run_module\nrun_module('sleeper', {'a.csv': b'1'})\n"
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
    (tmp_path / "sleeper.py").write_text(SLEEPER)
    (tmp_path / "tmp").mkdir()
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    environment = {**os.environ, "PYTHONPATH": paths, "TMPDIR": str(tmp_path / "tmp"), "HOME": str(tmp_path)}
    pid = tmp_path / "pid"
    with subprocess.Popen(
        [sys.executable, "-c", program], env=environment, stderr=subprocess.PIPE, text=True
    ) as parent:
        until(lambda: pid.exists() and pid.read_text() != "")
        parent.send_signal(sent)
        assert parent.communicate() == (None, said)
    assert parent.returncode == status
    until(lambda: not alive(int(pid.read_text())))
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
