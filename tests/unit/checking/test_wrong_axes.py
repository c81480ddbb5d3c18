"""Wrong axes and signs are found, and the advice puts them right."""

import re
from dataclasses import replace

import numpy as np
import pytest

from irt.checking import check
from irt.checking.run import axes_and_units
from irt.conventions import CONVENTIONS
from irt.engine import SUBSTEP_S, rollouts
from irt.errors import IrtError
from irt.recording import KNOBS, MARBLE, TILT
from simulated_rigs import STEP_S, TRUTH

WRONG = [one for one in CONVENTIONS if not one.is_declared]


def columns_of(recording):
    found = dict(zip((*KNOBS, *MARBLE), (*recording.knobs.T, *recording.marble.T), strict=True))
    if recording.tilt is not None:
        found.update(zip(TILT, recording.tilt.T, strict=True))
    return {name: values.copy() for name, values in found.items()}


def with_columns(rig, change):
    """Return a rig after a change of each recording's columns by name."""
    recordings = []
    for one in rig.recordings:
        columns = columns_of(one)
        change(columns)
        arrays = {"knobs": KNOBS, "marble": MARBLE}
        if one.tilt is not None:
            arrays["tilt"] = TILT
        recordings.append(
            replace(
                one,
                **{
                    name: np.stack([columns[column] for column in pair], axis=1)
                    for name, pair in arrays.items()
                },
            )
        )
    return replace(rig, recordings=tuple(recordings))


def distorted(rig, convention, pair):
    """Return a rig with one pair of columns swapped and mirrored."""

    def change(columns):
        x, y = columns[pair[0]], columns[pair[1]]
        if convention.swapped:
            x, y = y, x
        columns[pair[0]], columns[pair[1]] = convention.signs[0] * x, convention.signs[1] * y

    return with_columns(rig, change)


def follow(advice):
    """Return the change of columns that an advice asks for."""

    def change(columns):
        if pair := re.search(r"swap (\w+) and (\w+)", advice):
            first, second = pair.groups()
            columns[first], columns[second] = columns[second], columns[first]
        if names := re.search(r"change the sign of ([\w ]+)", advice):
            for name in names.group(1).split(" and "):
                columns[name.strip()] *= -1.0

    return change


def with_tilt(rig):
    """Return a rig whose board was measured, with a zero and noise."""
    random = np.random.default_rng(1)
    recordings = []
    for one in rig.recordings:
        tilt = one.knobs * TRUTH[0, :2] + [0.02, -0.04] + 0.0002 * random.standard_normal(one.knobs.shape)
        recordings.append(replace(one, tilt=tilt))
    return replace(rig, recordings=tuple(recordings))


@pytest.fixture(scope="module")
def findings_after():
    """Return a function that checks a rig after what an advice asks for, and each rig that results once."""
    known = {}

    def check_after(wrong, advice):
        mended = with_columns(wrong, follow(advice))
        if mended.digest not in known:
            known[mended.digest] = list(axes_and_units(mended))
        return known[mended.digest]

    return check_after


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("pair", [KNOBS, MARBLE])
@pytest.mark.parametrize("convention", WRONG)
def test_the_advice_puts_commands_and_marble_right(make_rig, findings_after, convention, pair, stamped):
    wrong = distorted(make_rig(stamped=stamped), convention, pair)
    found = check(wrong)
    (finding,) = [one for one in found.findings if one.where == "axes"]
    assert finding.severity == "error"
    with pytest.raises(IrtError, match=re.escape(finding.advice)):
        found.require()
    assert found.identified is None
    assert findings_after(wrong, finding.advice) == []


@pytest.mark.parametrize("convention", WRONG)
def test_a_few_rows_only_warn(make_rig, convention):
    short = distorted(make_rig(runs=1, rows=90), convention, MARBLE)
    severities = {one.severity for one in check(short).findings if one.where == "axes"}
    assert severities <= {"warning"}


def test_right_axes_are_never_refused(make_rig):
    for noise in (0.001, 0.01, 0.05):
        assert not [one for one in axes_and_units(make_rig(noise=noise)) if one.severity == "error"]


@pytest.mark.slow
@pytest.mark.parametrize("pair", [KNOBS, MARBLE, TILT])
@pytest.mark.parametrize("convention", WRONG)
def test_with_a_measured_tilt_the_guilty_columns_are_named(make_rig, findings_after, convention, pair):
    wrong = distorted(with_tilt(make_rig()), convention, pair)
    (finding,) = [one for one in check(wrong).findings if one.where == "axes"]
    assert set(re.findall(r"\w+_[xy](?:_rad)?", finding.advice)) <= set(pair)
    assert findings_after(wrong, finding.advice) == []


def test_the_gain_of_a_rolling_sphere_is_measured(make_rig):
    found = check(with_tilt(make_rig()))
    (response,) = [one for one in found.responses if one.inputs == TILT]
    assert response.unit == "m/s^2 per rad"
    for gain, error in (
        (response.gain[0][1], response.error[0][1]),
        (-response.gain[1][0], response.error[1][0]),
    ):
        assert gain == pytest.approx(7.0, abs=max(4.0 * error, 0.35))


def test_positions_in_metres_are_refused_by_the_gain(make_rig):
    rig = with_tilt(make_rig())
    metres = with_columns(
        rig, lambda columns: columns.update({name: 0.276 * columns[name] for name in MARBLE})
    )
    (error,) = [one for one in check(metres).findings if one.severity == "error"]
    assert (error.where, "metres" in error.advice) == ("tilt to marble", True)


def test_gears_of_either_sign_make_mirrored_commands_right(make_rig):
    rig = make_rig()
    either = {**rig.ranges, "gear_x": (-0.1, 0.1), "gear_y": (-0.1, 0.1)}
    mirrored = distorted(replace(rig, ranges=either), CONVENTIONS[3], KNOBS)
    assert not [one for one in check(mirrored).findings if one.where == "axes"]


@pytest.mark.parametrize("convention", WRONG)
def test_a_single_run_with_other_axes_is_named(make_rig, convention):
    rig = make_rig()
    odd = distorted(replace(rig, recordings=rig.recordings[2:3]), convention, KNOBS)
    mixed = replace(rig, recordings=(*rig.recordings[:2], *odd.recordings, *rig.recordings[3:]))
    (found,) = axes_and_units(mixed)
    assert (found.severity, found.where) == ("warning", "run-3")
    mended = with_columns(odd, follow(found.advice)).recordings[0]
    again = replace(rig, recordings=(*rig.recordings[:2], mended, *rig.recordings[3:]))
    assert axes_and_units(again) == ()


def test_time_between_rows_is_the_simulated_one():
    assert pytest.approx(STEP_S) == TRUTH[0, 3] * SUBSTEP_S
    assert rollouts(TRUTH, np.zeros((5, 2))).shape == (1, 5, 2)
