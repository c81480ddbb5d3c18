"""Few long recordings are cut into parts, which lose no row and no command; others stay as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.diagnosis.dataset import Dataset
from irt.diagnosis.parts import in_parts
from irt.recording import Recording
from irt.rig import Rig, Start


def rig_of(*rows: int, row_s: float | None = 1.0 / 30.0, tilt: bool = False, start: Start = "moving") -> Rig:
    """Return a rig of recordings of so many rows, stamped or not, whose commands are their row numbers."""

    def recording(number: int, length: int) -> Recording:
        steps = np.arange(length)
        commands = 1e-3 * np.stack([steps, -steps], axis=1)
        marble = 0.3 * np.stack([np.sin(0.1 * steps), np.cos(0.13 * steps)], axis=1)
        stamps = None if row_s is None else row_s * steps
        measured = 0.1 * commands if tilt else None
        return Recording(f"run-{number}", Path(f"run-{number}.csv"), commands, marble, stamps, measured)

    ranges = {"time_scale": (7.0, 9.0)}
    recordings = [recording(number, length) for number, length in enumerate(rows)]
    return Rig.from_recordings(recordings, ranges=ranges, start=start)


@given(rows=st.lists(st.integers(2, 2000), min_size=1, max_size=2), is_stamped=st.booleans())
def test_parts_are_the_recording(rows: list[int], is_stamped: bool) -> None:
    rig = rig_of(*rows, row_s=1.0 / 30.0 if is_stamped else None)
    parts = in_parts(rig).recordings
    for whole in rig.recordings:
        own = [one for one in parts if one.name.split(",")[0] == whole.name]
        assert np.array_equal(np.concatenate([one.knobs for one in own]), whole.knobs)
        assert np.array_equal(np.concatenate([one.marble for one in own]), whole.marble)
        assert all(len(one.knobs) >= 90 for one in own) or len(own) == 1
    assert len({one.name for one in parts}) == len(parts)


@pytest.mark.parametrize(
    ("rows", "parts"), [((150,), 1), ((400,), 4), ((3000,), 10), ((300, 300), 4), ((2000, 150), 8)]
)
def test_numbers_of_parts(rows: tuple[int, ...], parts: int) -> None:
    cut = in_parts(rig_of(*rows))
    assert len(cut.recordings) == parts


def test_three_recordings_are_enough_and_those_from_rest_stay_whole() -> None:
    for rig in (rig_of(3000, 3000, 3000), rig_of(3000, start="rest")):
        assert in_parts(rig) is rig


def test_a_part_begins_where_the_marble_is_seen() -> None:
    rig = rig_of(400)
    (whole,) = rig.recordings
    marble = whole.marble.copy()
    marble[95:110] = np.nan
    lost = Rig.from_recordings(
        [Recording("a", Path("a.csv"), whole.knobs, marble, whole.stamps)],
        ranges=dict(rig.ranges),
        start="moving",
    )
    first, second, *_ = in_parts(lost).recordings
    assert len(first.knobs) == 100
    assert second.knobs[0, 0] == whole.knobs[110, 0]
    assert second.before is not None
    assert second.before[0] == whole.knobs[109, 0]
    assert second.stamps is not None
    assert np.array_equal(second.stamps, whole.stamps[110:200])


def test_a_dataset_holds_parts_out() -> None:
    whole = rig_of(900, tilt=True)
    dataset = Dataset.of(whole)
    assert dataset.in_parts
    assert len(dataset.rig.recordings) == 4
    assert sorted(set(dataset.folds.tolist())) == [0, 1, 2, 3]
    assert dataset.has_tilt
    tilts = [one.run.tilt for one in dataset.runs]
    together = np.concatenate([tilt for tilt in tilts if tilt is not None])
    # What commands from before a part do to its tilt is unknown for half a second.
    known = np.isfinite(together).all(axis=1)
    assert np.count_nonzero(~known) == 4 * 15
    assert np.array_equal(together[known], whole.recordings[0].tilt[known])  # type: ignore[index]
    assert dataset.digest == whole.digest
    assert not Dataset.of(rig_of(150)).in_parts
