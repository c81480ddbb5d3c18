"""Bags of other labs: topics by type, headers or not, definitions or not."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path

import numpy as np
import pytest

import lab_logs
from irt.errors import IrtError
from irt.importing.lab_bags import read_bag, topics_of
from lab_logs import Convention, Truth, simulate, write_bag

PLAIN = Convention(np.ones(2), False, np.ones(2), 0.0)


@pytest.fixture(scope="module")
def truth() -> Truth:
    return simulate(np.random.default_rng(0), seconds=3.0, spoil=False)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("sub_image", [False, True])
@pytest.mark.parametrize("header", [None, 0.0])
def test_states_and_commands_by_the_types_of_their_messages(
    tmp_path: Path, truth: Truth, storage: str, sub_image: bool, header: float | None
) -> None:
    bag = write_bag(
        tmp_path / "bag",
        truth,
        PLAIN,
        storage=storage,
        package="fork_msgs",
        topics=("/lab/cyber/estimate", "/lab/cmd"),
        sub_image=sub_image,
        header_offset=header,
    )
    states, commands, notes = read_bag(bag)
    assert np.allclose(states["x_b"], truth.marble_m[:, 0])
    assert np.allclose(states["alpha"], truth.tilt[:, 0])
    assert np.allclose(states["t_s"] - lab_logs.BEGIN, truth.stamps, atol=1e-6)
    assert np.allclose(commands["vel_2"], truth.commands[:, 1])
    assert np.allclose(commands["t_s"] - lab_logs.BEGIN, truth.command_stamps, atol=1e-6)
    assert sum("no headers" in note for note in notes) == 1


def test_one_file_of_a_bag_and_a_bag_without_metadata(tmp_path: Path, truth: Truth) -> None:
    bag = write_bag(tmp_path / "bag", truth, PLAIN)
    (file,) = bag.glob("*.db3")
    assert np.array_equal(read_bag(file)[0]["x_b"], read_bag(bag)[0]["x_b"])
    (bag / "metadata.yaml").unlink()
    assert set(topics_of(bag)) == {"/stateEstimation", "/cyberrunner_dynamixel/cmd"}


def test_two_topics_with_states_must_be_chosen_from(tmp_path: Path, truth: Truth) -> None:
    bag = write_bag(tmp_path / "bag", truth, PLAIN, extra=("/filtered",))
    with pytest.raises(
        IrtError, match=r"2 topics with states \(/filtered, /stateEstimation\); choose one with --topic"
    ):
        read_bag(bag)
    assert len(read_bag(bag, ["/filtered"])[0]["x_b"]) == len(truth.stamps)
    with pytest.raises(IrtError, match="no topic /other; the bag has /cyberrunner_dynamixel/cmd"):
        read_bag(bag, ["/other"])


def retyped(path: Path, old: str, new: str) -> None:
    for file in path.glob("*.db3"):
        with contextlib.closing(sqlite3.connect(file)) as base:
            base.execute("UPDATE topics SET type = replace(type, ?, ?)", (old, new))
            base.commit()
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(old, new))


def test_a_bag_without_states(tmp_path: Path, truth: Truth) -> None:
    bag = write_bag(tmp_path / "bag", truth, PLAIN)
    retyped(bag, "/StateEstimate", "/BallState")
    with pytest.raises(
        IrtError, match=r"no topic with states \(StateEstimate or StateEstimateSub\); the bag has"
    ):
        read_bag(bag)


def test_messages_that_nobody_defines(tmp_path: Path, truth: Truth) -> None:
    bag = write_bag(tmp_path / "bag", truth, PLAIN)
    retyped(bag, "/StateEstimate", "/BallState")
    with pytest.raises(IrtError, match="BallState, whose definition is neither in the bag nor known here"):
        read_bag(bag, ["/stateEstimation"])
    retyped(bag, "/BallState", "/StateEstimate")
    retyped(bag, "/DynamixelVel", "/StateEstimate")
    with pytest.raises(IrtError, match="have other fields than are known here"):
        read_bag(bag, ["/cyberrunner_dynamixel/cmd"])


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.9])
def test_a_bag_that_was_cut_short(tmp_path: Path, truth: Truth, storage: str, share: float) -> None:
    bag = write_bag(tmp_path / "bag", truth, PLAIN, storage=storage)
    (file,) = [*bag.glob("*.db3"), *bag.glob("*.mcap")]
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    for path in (bag, file):
        with pytest.raises(IrtError, match="cut short") as caught:
            read_bag(path)
        assert "\n" not in str(caught.value)


def test_what_is_no_bag(tmp_path: Path) -> None:
    with pytest.raises(IrtError, match=r"no such file"):
        read_bag(tmp_path / "absent.db3")
    (tmp_path / "text.db3").write_text("no bag" * 100)
    with pytest.raises(IrtError, match="no bag, or one that was cut short"):
        read_bag(tmp_path / "text.db3")
    (tmp_path / "folder").mkdir()
    with pytest.raises(IrtError, match=r"no bag file and no metadata\.yaml"):
        read_bag(tmp_path / "folder")
