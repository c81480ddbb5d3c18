"""The cache of the engine's answers survives an interruption."""

import numpy as np
import pytest

from irt.errors import IrtError
from irt.fitting.unfinished import Unfinished, answered

ANSWER = {
    "values": np.array([[0.1, np.nan], [np.inf, -0.0]]),
    "free": [0, 2],
    "noise": 1.0 / 3.0,
    "parts": [(np.arange(3), 2.5e-17), (np.zeros((0, 2)), float("nan"))],
    "none": None,
    "is": True,
}


class Engine:
    """Counts its calls, and can be interrupted."""

    def __init__(self):
        self.asked = 0

    def ask(self, problem, values, **options):
        if problem.get("stop"):
            raise KeyboardInterrupt
        self.asked += 1
        return {**ANSWER, "asked": float(values[0])}


@pytest.fixture
def engine():
    return Engine()


def interrupted(path, engine):
    """Ask three questions, the third of which is interrupted."""

    def ask():
        with Unfinished.of(path, "abc", 0).used():
            for value in (1.0, 2.0):
                answered(engine.ask, {"threads": 1, "rows": 3}, np.array([value]))
            answered(engine.ask, {"stop": True}, np.zeros(1))

    with pytest.raises(KeyboardInterrupt):
        ask()


def test_answers_come_back_bit_for_bit_and_are_not_asked_again(tmp_path, engine):
    interrupted(tmp_path / "state", engine)
    again = Unfinished.of(tmp_path / "state", "abc", 0)
    assert (len(again), again.stale) == (2, ())
    with again.used():
        found = answered(engine.ask, {"threads": 2, "rows": 3}, np.array([2.0]), progress=print)
        answered(engine.ask, {"threads": 2, "rows": 4}, np.array([2.0]))
    assert engine.asked == 3
    assert found["values"].tobytes() == ANSWER["values"].tobytes()
    assert found["values"].flags.writeable
    assert (found["free"], found["noise"], found["none"], found["is"]) == ([0, 2], 1.0 / 3.0, None, True)
    assert [one.dtype for one, _ in found["parts"]] == [np.arange(3).dtype, np.zeros(0).dtype]
    assert found["parts"][1][0].shape == (0, 2)
    assert found["asked"] == 2.0
    assert not (tmp_path / "state").exists()


def test_outside_of_a_work_the_engine_is_asked(engine):
    for _ in range(2):
        answered(engine.ask, {}, np.zeros(1))
    assert engine.asked == 2


@pytest.mark.parametrize(("recordings", "seed", "stale"), [("abd", 0, "recordings"), ("abc", 1, "seed")])
def test_answers_to_another_work_are_of_no_use(tmp_path, engine, recordings, seed, stale):
    interrupted(tmp_path / "state", engine)
    other = Unfinished.of(tmp_path / "state", recordings, seed)
    assert (len(other), other.stale) == (0, (stale,))


@pytest.mark.parametrize("cut", [1, 40])
def test_a_line_cut_short_is_left_out(tmp_path, engine, cut):
    path = tmp_path / "state"
    interrupted(path, engine)
    path.write_text(path.read_text()[:-cut])
    assert len(Unfinished.of(path, "abc", 0)) == 1
    interrupted(path, engine)
    assert len(Unfinished.of(path, "abc", 0)) == 2


def test_a_file_of_another_kind_is_of_no_use(tmp_path):
    path = tmp_path / "state"
    path.write_bytes(b"\xff\x00 no text")
    assert len(Unfinished.of(path, "abc", 0)) == 0


def test_where_nothing_can_be_written_the_file_is_named(tmp_path):
    with (
        pytest.raises(IrtError, match="none/state"),
        Unfinished.of(tmp_path / "none" / "state", "a", 0).used(),
    ):
        pass
