"""Changed files are read or refused with one line; no other error, no hang, no memory without end."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from guard import little_memory, outcome
from hypothesis import given, settings
from mutations import edited_bytes, edited_text
from readers import READERS, Reader

HERE = Path(__file__).parent
#: These take longer for an input than the others.
_EXAMPLES = {"import": 8, "lab-mcap": 15, "lab-sqlite3": 15, "rig-bag": 20}


@pytest.mark.parametrize("reader", [one for one in READERS if not one.isolated], ids=lambda one: one.name)
def test_changed_files_are_read_or_refused_with_one_line(reader: Reader) -> None:
    seeds = reader.seeds()
    files = edited_text(seeds) if isinstance(seeds[0], str) else edited_bytes(seeds)

    @given(files)
    @settings(max_examples=_EXAMPLES.get(reader.name, 40), deadline=None)
    def read(data: bytes) -> None:
        outcome(reader, data)

    with little_memory():
        read()


@pytest.mark.parametrize("reader", READERS, ids=lambda one: one.name)
def test_seeds_are_read(reader: Reader) -> None:
    for seed in reader.seeds():
        assert outcome(reader, seed.encode() if isinstance(seed, str) else seed) is None


@pytest.mark.slow
def test_changed_videos_are_read_or_refused_with_one_line(tmp_path: Path) -> None:
    words = (HERE / "fuzz.py", "video", "--seconds", "3", "--seed", "1", "--out", tmp_path)
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""


@pytest.mark.slow
def test_fuzzing_finds_a_planted_fault(tmp_path: Path) -> None:
    """A reader with a fault that one changed file in some hundred meets: the program keeps that file."""
    planted = (
        "import readers, runpy, sys\n"
        "def read(folder, data):\n"
        "    if data.count(b'\\n') != 8: raise KeyError('planted')\n"
        "readers.READERS = (readers.Reader('planted', readers._texts('camera.toml'), read),)\n"
        "sys.argv = ['fuzz.py', '--seconds', '5', '--seed', '1', '--out', sys.argv[1]]\n"
        "runpy.run_path('fuzz.py', run_name='__main__')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", planted, str(tmp_path)],
        cwd=HERE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE.parent), *sys.path])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    assert "KeyError at <string>:3 read" in done.stdout
    (kept, *_) = tmp_path.iterdir()
    assert kept.name.startswith("planted-")
