"""Answers that stay: each rig under one set of instructions, number of threads, with or without the extras.

`pinned_answers.json` was written by ``python tests/answers_of_rigs.py``. The instruction sets of the engine
give the same bits (`crates/labsim/src/engine/rolling/tests.rs`); here numpy, its matrix library and the C
library lack theirs.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

TESTS = Path(__file__).resolve().parents[1]
PINNED = json.loads((TESTS / "pinned_answers.json").read_text())


def without(*newest: str) -> dict[str, str]:
    """Return variables with which numpy lacks these instructions, or all that it can do without."""
    umath = np._core._multiarray_umath
    has = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__.get(name)]
    lacks = [name for name in has if not newest or name.startswith(newest)]
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(lacks)} if lacks else {}


AVX2 = {**without("AVX512", "X86_V4"), "OPENBLAS_CORETYPE": "Haswell"}
BASELINE = {
    **without(),
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA",
}
RIGS = list(PINNED)


def like(pinned):
    """Return what an answer has to equal, to a unit of the third digit; intervals to 0.2 % of their width."""
    if isinstance(pinned, dict):
        return {key: like(value) for key, value in pinned.items()}
    if isinstance(pinned, list) and None not in pinned:
        return pytest.approx(pinned, rel=1e-2, abs=2e-3 * (pinned[2] - pinned[1]))
    return pytest.approx(pinned, rel=1e-2) if isinstance(pinned, float) else pinned


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variables", "words", "rigs"),
    [
        pytest.param({}, ("--threads", "2"), RIGS[::3], id="own"),
        pytest.param(AVX2, ("--threads", "1", "--without-extras"), RIGS[1::3], id="avx2"),
        pytest.param(BASELINE, ("--threads", "3"), RIGS[2::3], id="baseline"),
    ],
)
def test_answers_stay(variables, words, rigs):
    command = [sys.executable, TESTS / "answers_of_rigs.py", *words, *rigs]
    done = subprocess.run(
        command, env={**os.environ, **variables}, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    answers = json.loads(done.stdout)
    assert list(answers) == rigs
    for name, answer in answers.items():
        assert answer == like(PINNED[name]), name
