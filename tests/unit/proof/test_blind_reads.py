"""The diagnosis as a process of its own: what it may see is all that it reads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import irt
from irt.workers import processes as workers
from irt.workers.processes import LocalWorkers, environment, files_of, run_module

BLIND = "irt.proof.blind"

#: Runs the module with an ear on every file that is opened, listed, linked or sent for.
WATCHED = """
import json, runpy, sys
heard = []
def hear(event, given):
    if event in ("open", "os.listdir", "os.scandir") and given and not isinstance(given[0], int):
        heard.append([event, str(given[0])])
    elif event.startswith(("socket.connect", "subprocess.", "os.exec", "os.posix_spawn", "ctypes.dlopen")):
        heard.append([event, ""])
log = sys.argv.pop(1)
sys.argv[0] = sys.argv.pop(1)
sys.addaudithook(hear)
try:
    runpy.run_module("irt.proof.blind", run_name="__main__")
except SystemExit as stop:
    assert not stop.code, stop.code
with open(log, "w") as file:
    json.dump(heard, file)
"""


@pytest.fixture
def rig(places, tmp_path: Path) -> Path:
    """Return a rig's folder under a name that says nothing, beside a proof."""
    folder = tmp_path / "seen" / "rig"
    folder.mkdir(parents=True)
    for name, data in files_of(places.rig("rig-0001")).items():
        (folder / name).write_bytes(data)
    return folder


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "PATIENCE_S", 120.0)


@pytest.mark.slow
def test_it_reads_nothing_but_the_rig_and_the_program(rig: Path, tmp_path: Path) -> None:
    out, log = rig.with_name("out"), tmp_path / "log.json"
    out.mkdir()
    command = [sys.executable, "-P", "-c", WATCHED, str(log), BLIND, str(rig), str(out)]
    subprocess.run(command, env=environment(), cwd=rig.parent, check=True, timeout=120)
    heard = json.loads(log.read_text())
    package = Path(irt.__file__).parent
    program = [package, *(Path(place) for place in (sys.prefix, sys.base_prefix, sys.exec_prefix))]
    allowed = {os.path.realpath(place) for place in (*program, rig, out, "/proc", "/sys", "/dev")}
    # To find the program, the interpreter looks into each place that it may be in.
    looked_into = {os.path.realpath(place) for place in (*sys.path, package.parent)}
    strange = [
        (event, path)
        for event, path in heard
        if not any(os.path.realpath(path).startswith(f"{place}{os.sep}") for place in allowed)
        and os.path.realpath(path) not in allowed
        and not (event == "os.listdir" and os.path.realpath(path) in looked_into)
        and not (event == "ctypes.dlopen" or path == str(log))
    ]
    assert not strange
    assert {"train-1.csv", "train-2.csv", "train-3.csv", "rig.toml"} <= {
        Path(path).name for event, path in heard if event == "open"
    }
    assert {path.name for path in out.iterdir()} >= {"diagnosis.json", "base.toml", "model.toml"}


def test_the_environment_reveals_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("IRT_VAULT", "secret")
    monkeypatch.setenv("PYTHONPATH", "python")
    variables = environment()
    assert "IRT_VAULT" not in variables
    assert variables["OMP_NUM_THREADS"] == "1"
    places = variables["PYTHONPATH"].split(os.pathsep)
    assert places[0] == str(Path(irt.__file__).resolve().parents[1])
    assert all(Path(place).is_absolute() for place in places)


@pytest.mark.slow
def test_the_same_recordings_give_the_same_bytes_under_any_name(places) -> None:
    """The process receives only the recordings of a rig, so the answer cannot depend on more."""
    files = files_of(places.rig("rig-0001"))
    inputs = {"rig-0001": files, "other": dict(reversed(files.items()))}
    one, other = dict(LocalWorkers(2).each(BLIND, inputs)).values()
    one.pop("seconds.json")
    other.pop("seconds.json")
    assert one == other
    assert json.loads(one["diagnosis.json"])["settings"]["seed"] == 0


def test_a_diagnosis_that_fails_says_why(places) -> None:
    files = files_of(places.rig("rig-0001"))
    broken = run_module(BLIND, {**files, "train-1.csv": b"step\n"})
    assert list(broken) == ["failed.json"]
    reason = json.loads(broken["failed.json"])["error"]
    assert reason.startswith("rig/train-1.csv, line 1: column knob_x_rad is missing")


def test_one_that_takes_too_long_is_ended(monkeypatch: pytest.MonkeyPatch, places) -> None:
    monkeypatch.setattr(workers, "PATIENCE_S", 0.2)
    files = run_module(BLIND, files_of(places.rig("rig-0001")))
    assert json.loads(files["failed.json"]) == {"error": "took longer than 0.2 s"}
