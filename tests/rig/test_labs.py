"""The rig beside the interfaces of other labs: their learners on the twin, and runs with its safety rules."""

from __future__ import annotations

import json
import math
import sys
import tomllib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from laboratory import messages
from learners import CYBERRUNNER
from numpy.typing import NDArray

from irt.cli.__main__ import main
from irt.recording import load_recording

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
Inside = Callable[..., CompletedProcess[str]]

pytestmark = pytest.mark.slow

ROLLING = 5.0 / 7.0 * 9.81
PARAMETERS = """
[parameters]
gear_x = {{ value = {0} }}
gear_y = {{ value = {1} }}
rolling_friction = {{ value = 3e-4 }}
time_scale = {{ value = 4.0 }}
observation_scale = {{ value = 1.0 }}
"""
KNOBS = PARAMETERS.format(0.07, 0.06)
#: A hole on the way along -x.
HOLE = "[maze]\nwall_thickness_m = 0.005\nhole_radius_m = 0.009\nholes = [[-0.04, 0.0]]\n"
#: Commands in the lab's own unit: a negative gear, and a dead time.
OWN = '[commands]\nunit = "of the lab"\n[[effects]]\nname = "delay"\ndelay_s = 0.1\n' + PARAMETERS.format(
    -3e-4, 4e-4
)

#: Starts a twin, and runs a command beside it.
BESIDE = """
rig=$1 lab=$2; shift 2
"$rig" twin --model model.toml --as "$lab" & "$@"
status=$?
kill $!
exit $status
"""

#: The same, with something that happens while the file is played.
FAULT = """
rig=$1 lab=$2 inject=$3
"$rig" twin --model model.toml --as "$lab" & twin=$!
"$rig" play run.csv --out bags --arm & play=$!
until grep -q playing bags/run.mcap 2>/dev/null; do sleep 0.05; kill -0 $play || break; done
sleep 1
eval "$inject"
wait $play; status=$?
kill -9 $twin
kill $(jobs -p) 2>/dev/null
exit $status
"""


def acceleration(t: NDArray[np.float64], tilt: NDArray[np.float64], place: NDArray[np.float64]) -> float:
    """Return the factor from tilt to acceleration, of a marble that begins at rest or not."""

    def integral(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2.0 * np.diff(t))])

    columns = np.column_stack([integral(integral(tilt)), t - t[0], np.ones(t.size)])
    return float(np.linalg.lstsq(columns, place, rcond=None)[0][0])


def test_a_cyberrunners_learner_moves_the_marble_of_the_twin(
    rig: Path, inside: Inside, cyclone: None, tmp_path: Path
) -> None:
    (tmp_path / "model.toml").write_text(KNOBS + HOLE)
    (tmp_path / "rig.toml").write_text('[network]\nservices = "cyclone"\n[twin]\nlost = 0.15\n')
    words = (rig, "cyberrunner", sys.executable, HERE / "learners.py", "cyberrunner", "out.json")
    ran = inside("bash", "-c", BESIDE, "_", *words, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    found = json.loads((tmp_path / "out.json").read_text())
    t, x, y, alpha, beta, velocity = np.array(found["rows"]).T
    # In the namespace's clock the pictures come as often as a real one's.
    assert 55.0 < t.size / (t[-1] - t[0]) < 62.0
    assert abs(found["plain"] - t.size) < 60
    # An action of 1 is a command of -200: alpha rises, and the marble rolls to where x falls, into the hole.
    assert alpha.max() > 0.03
    before = slice(0, int(np.flatnonzero(x < -0.025)[0]))
    seen = np.isfinite(x[before])
    assert 0.6 < seen.mean() < 1.0, "pictures are lost as configured"
    assert acceleration(t[before][seen], alpha[before][seen], x[before][seen]) == pytest.approx(
        -ROLLING, rel=0.15
    )
    assert velocity[before][seen][-1] < -0.05
    assert np.isnan([x[-20:], y[-20:]]).all()
    assert np.isfinite(alpha).all()
    assert beta.max() > 0.03
    # The reset levels the board, and brings the marble back.
    assert found["success"] == 1
    assert 0.05 < found["took"] < 5.0
    _, x, y, alpha, beta, _ = np.array(found["after"]).T
    assert np.nanmax(np.abs([x, y])) < 0.005
    assert np.abs([alpha, beta]).max() < 0.01
    # Blue first, as its camera has it: wood at the corner, steel in the middle.
    picture = found["picture"]
    assert picture["shape"] == [64, 64, 192, 12288]
    assert (picture["encoding"], picture["corner"]) == ("8UC3", [120, 169, 206])
    assert picture["middle"][0] > picture["middle"][2] > 180


def test_a_tag_learner_moves_the_marble_of_the_twin(rig: Path, inside: Inside, tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(KNOBS)
    words = (rig, "tag-tcp", sys.executable, HERE / "learners.py", "tag", "out.json")
    ran = inside("bash", "-c", BESIDE, "_", *words, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    found = json.loads((tmp_path / "out.json").read_text())
    assert [one["ok"] for one in found["wrong"]] == [False] * 3
    assert "fly" in found["wrong"][1]["error"]
    assert "65536" in found["wrong"][2]["error"]
    assert found["picture"] == 64 * 64
    t, _, y, alpha, beta = np.array(found["rows"]).T
    # Servo 1: 150 units of 0.24 degrees of a knob, through the gear.
    assert np.median(beta[-20:]) == pytest.approx(0.07 * math.radians(36.0), abs=0.002)
    assert np.median(alpha[-5:]) == pytest.approx(-0.06 * math.radians(36.0), abs=0.004)
    seen = np.isfinite(y) & (np.abs(y) < 0.08)
    assert acceleration(t[seen], beta[seen], y[seen]) == pytest.approx(-ROLLING, rel=0.15)
    _, *_, alpha, beta = found["silent"]
    assert abs(alpha) < 0.005
    assert abs(beta) < 0.005
    assert found["reset"] == {"ok": True}
    assert np.abs(found["after"][1:3]).max() < 0.005


COMMANDS = {"cyberrunner": "/cyberrunner_dynamixel/cmd", "tag": "/tag_hiwonder/cmd"}
STATES = {
    "cyberrunner": "/cyberrunner_state_estimation/estimate_subimg",
    "tag": "/tag_state_estimation/estimate",
}
NAMES = {"cyberrunner": "cyberrunner", "tag": "tag-tcp"}

#: A twin, a recording of it, and a learner that ends first.
LISTEN = """
rig=$1; shift
"$rig" twin --model model.toml --as cyberrunner & twin=$!
"$rig" listen --out bags --seconds 6 & listen=$!
"$@" && wait $listen
status=$?
kill $twin
exit $status
"""


def test_a_session_of_a_learner_is_recorded(rig: Path, inside: Inside, cyclone: None, tmp_path: Path) -> None:
    folder = laboratory(tmp_path / "lab", "cyberrunner")
    words = (rig, sys.executable, HERE / "learners.py", "cyberrunner", "out.json")
    ran = inside("bash", "-c", LISTEN, "_", *words, cwd=folder)
    assert ran.returncode == 0, ran.stderr
    bag = folder / "bags" / "listen.mcap"
    rows = json.loads((folder / "out.json").read_text())["rows"]
    commands = [tuple(row) for row in numbers(bag, COMMANDS["cyberrunner"], "vel_1", "vel_2")[:, 1:]]
    assert commands == [(vel_1, vel_2) for _, vel_1, vel_2 in CYBERRUNNER]
    states = numbers(bag, STATES["cyberrunner"], "alpha", "beta")
    assert states.shape[0] > len(rows)
    # The learner saw the same numbers.
    assert {(row[3], row[4]) for row in rows} <= {(row[1], row[2]) for row in states}


def test_a_recording_of_a_tag_rig_asks_for_states_alone(rig: Path, inside: Inside, tmp_path: Path) -> None:
    folder = laboratory(tmp_path / "lab", "tag")
    listen = (rig, "listen", "--out", "bags", "--seconds", "3")
    ran = inside("bash", "-c", BESIDE, "_", rig, "tag-tcp", *listen, cwd=folder)
    assert ran.returncode == 0, ran.stderr
    bag = folder / "bags" / "listen.mcap"
    states = numbers(bag, STATES["tag"], "alpha", "beta")
    assert 90 < states.shape[0] < 185
    assert len(np.unique(states[:, 1])) == states.shape[0], "each state is there once"
    assert numbers(bag, COMMANDS["tag"], "vel_1").size == 0


def laboratory(folder: Path, lab: str, *, amplitude: float = 90.0) -> Path:
    """Write a model in the lab's unit, a configuration that may arm, and commands of motors 1 and 2."""
    folder.mkdir(exist_ok=True)
    text = (ROOT / "rig" / "example" / f"{lab}.toml").read_text(encoding="utf-8")
    for old, new in (
        ("allow_arming = false", "allow_arming = true"),
        ("overrun_s = 0.05", "overrun_s = 1.0"),
        ("tracker_s = 0.3", "tracker_s = 1.0"),
        ("joints_s = 0.2", "joints_s = 0.7"),
        ("[network]", "[network]\nmatch_s = 20.0"),
        ('services = "enhanced"', 'services = "cyclone"'),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "rig.toml").write_text(text)
    (folder / "model.toml").write_text(OWN)
    rows = ["t_s,vel_1,vel_2"]
    for i in range(140):
        t = 0.05 * i
        rows.append(f"{t:.2f},{amplitude * math.sin(3.1 * t):.3f},{amplitude * math.sin(2.3 * t):.3f}")
    (folder / "run.csv").write_text("\n".join(rows) + "\n")
    return folder


def numbers(bag: Path, topic: str, *names: str) -> NDArray[np.float64]:
    """Return times and fields of a topic's messages, a row each."""
    rows = []
    for which, logged, message in messages(bag):
        if which == topic:
            state = getattr(message, "state", message)
            rows.append([logged, *(getattr(state, name) for name in names)])
    return np.array(rows).reshape(-1, 1 + len(names))


@pytest.mark.parametrize("lab", ["cyberrunner", "tag"])
def test_a_run_is_played_recorded_shown_and_imported(
    rig: Path, inside: Inside, tmp_path: Path, capsys: pytest.CaptureFixture[str], lab: str
) -> None:
    folder = laboratory(tmp_path / "lab", lab)
    play = (rig, "play", "run.csv", "--out", "bags", "--arm")
    ran = inside("bash", "-c", BESIDE, "_", rig, NAMES[lab], *play, cwd=folder)
    assert ran.returncode == 0, ran.stderr
    bag = folder / "bags" / "run.mcap"
    commands = numbers(bag, COMMANDS[lab], "vel_1", "vel_2")
    assert np.abs(commands[:, 1:]).max() <= 90.0
    assert np.ptp(commands[:, 1:], axis=0).min() > 170.0
    assert (commands[-1, 1:] == 0.0).all()

    # The model's dead time of 0.1 s acts, and the picture is 0.03 s old; a servo's driver adds its own.
    angles = numbers(bag, STATES[lab], "alpha", "beta")
    lags = np.arange(0.0, 0.4, 0.005)
    own = commands[:, 2] if lab == "cyberrunner" else commands[:, 1]
    fits = [
        np.corrcoef(np.interp(angles[:, 0] - lag, commands[:, 0], own), angles[:, 2])[0, 1] for lag in lags
    ]
    assert fits[int(np.argmin(fits))] < -0.98, "the gear about x is negative"
    assert 0.11 < lags[int(np.argmin(fits))] < (0.16 if lab == "cyberrunner" else 0.25)

    # Viewers see the board as the estimator does.
    states = {row[0]: row for row in numbers(bag, STATES[lab], "alpha", "beta", "x_b", "y_b")}
    boards, balls = 0, 0
    for topic, logged, message in messages(bag):
        if topic != "/tf":
            continue
        (transform,) = message.transforms
        _, alpha, beta, x, y = states[logged]
        turn, place = transform.transform.rotation, transform.transform.translation
        if transform.child_frame_id == "maze":
            boards += 1
            assert 2.0 * turn.x == pytest.approx(beta, abs=1e-4)
            assert 2.0 * turn.y == pytest.approx(-alpha, abs=1e-4)
        else:
            balls += 1
            assert (transform.header.frame_id, transform.child_frame_id) == ("maze", "ball")
            assert (place.x, place.y) == (x, y)
    assert boards == len(states)
    assert 0.9 * boards < balls <= boards
    assert_every_link_has_a_place(bag)

    # What was recorded is imported as the lab's own: gears of the model, with their signs and its dead time.
    assert main(["import", str(bag), "--out", str(tmp_path / "rig")]) == 0
    output = capsys.readouterr().out
    assert "maze" not in output
    (recording,) = sorted((tmp_path / "rig").glob("*.csv"))[:1]
    assert load_recording(recording).tilt is not None
    ranges = tomllib.loads((tmp_path / "rig" / "rig.toml").read_text())["parameters"]
    for name, gear in (("gear_x", -3e-4), ("gear_y", 4e-4)):
        low, high = ranges[name]["range"]
        assert low < gear < high
        assert low * high > 0.0, "its sign is known"


def assert_every_link_has_a_place(bag: Path) -> None:
    """Check that links of the description hang together by transforms, from the world to the marble."""
    (description,) = [one.data for topic, _, one in messages(bag) if topic == "/robot_description"]
    robot = ElementTree.fromstring(description)
    joints = {
        (one.find("parent").get("link"), one.find("child").get("link")): one for one in robot.iter("joint")
    }
    assert {one.get("name") for one in robot.iter("link")} == {"world", "base", "maze", "ball"}
    (static,) = [one.transforms for topic, _, one in messages(bag) if topic == "/tf_static"]
    moving = [one.transforms for topic, _, one in messages(bag) if topic == "/tf"]
    frames = {(one.header.frame_id, one.child_frame_id) for transforms in moving for one in transforms}
    assert frames == {("world", "maze"), ("maze", "ball")}
    assert joints.keys() == frames | {("world", "base")}
    (base,) = static
    stand = joints[base.header.frame_id, base.child_frame_id]
    place = base.transform.translation
    assert stand.get("type") == "fixed"
    assert [float(one) for one in stand.find("origin").get("xyz").split()] == [place.x, place.y, place.z]
    # Descriptions come first: a viewer that reads from the start has them before the first pose.
    topics = [topic for topic, _, _ in messages(bag)]
    assert max(topics.index("/robot_description"), topics.index("/tf_static")) < topics.index("/tf")


E_STOP = f"PYTHONPATH={HERE} {sys.executable} -c '{{}}' & peer=$!"
PUBLISH = (
    'import time; from ros import Bool, Peer; writer = Peer().writer("/rig/e_stop", Bool)\n'
    "while True: writer.write(Bool(True)); time.sleep(0.05)"
)
INTRUDE = (
    "import time; from ros import DynamixelVel, Peer\n"
    'writer = Peer().writer("/cyberrunner_dynamixel/cmd", DynamixelVel); time.sleep(30)'
)
FAULTS = {
    "rig terminated": ("cyberrunner", "kill $play", "signal"),
    "twin killed": ("cyberrunner", "kill -9 $twin", "state_silent"),
    "e-stop": ("cyberrunner", E_STOP.format(PUBLISH), "emergency_stop"),
    "another publisher": ("cyberrunner", E_STOP.format(INTRUDE), "other_publisher"),
    "bridge killed": ("tag", "kill -9 $twin", "state_silent"),
    "bridge stalled": ("tag", "kill -STOP $twin", "state_silent"),
    "player terminated": ("tag", "kill $play", "signal"),
}


def test_each_fault_ends_in_a_command_of_zero(
    rig: Path, inside: Inside, cyclone: None, tmp_path: Path
) -> None:
    def observe(name: str) -> dict[str, Any]:
        lab, inject, reason = FAULTS[name]
        folder = laboratory(tmp_path / name.replace(" ", "-"), lab)
        ran = inside("bash", "-c", FAULT, "_", rig, NAMES[lab], inject, cwd=folder)
        bag = folder / "bags" / "run.mcap"
        commands = numbers(bag, COMMANDS[lab], "vel_1", "vel_2") if ran.returncode == 1 else np.zeros((1, 3))
        return {
            "status": ran.returncode,
            "says": reason in ran.stderr,
            "moved": float(np.abs(commands[:, 1:]).max()) > 10.0,
            "zero": (reason == "state_silent" and lab == "tag") or not commands[-1, 1:].any(),
            "err": ran.stderr,
        }

    with ThreadPoolExecutor(len(FAULTS)) as pool:
        found = dict(zip(FAULTS, pool.map(observe, FAULTS), strict=True))
    wrong = {name: one for name, one in found.items() if not (one["says"] and one["moved"] and one["zero"])}
    assert not wrong, json.dumps(wrong, indent=1)


def test_a_dry_run_commands_nothing(rig: Path, inside: Inside, tmp_path: Path) -> None:
    folder = laboratory(tmp_path / "lab", "cyberrunner")
    (folder / "run.csv").write_text("t_s,cmd_x,cmd_y\n0,0,0\n0.5,50,0\n1.0,0,0\n")
    ran = inside(
        "bash", "-c", BESIDE, "_", rig, "cyberrunner", rig, "play", "run.csv", "--out", "bags", cwd=folder
    )
    assert ran.returncode == 0, ran.stderr
    assert "dry run" in ran.stdout
    bag = folder / "bags" / "run.mcap"
    assert len(numbers(bag, STATES["cyberrunner"], "alpha")) > 100
    assert len(numbers(bag, COMMANDS["cyberrunner"], "vel_1")) == 0


@pytest.mark.parametrize(
    ("lab", "said"), [("cyberrunner", "nobody publishes there"), ("tag", "no bridge has connected")]
)
def test_a_rig_that_is_not_there_is_missed_in_one_line(
    rig: Path, inside: Inside, tmp_path: Path, lab: str, said: str
) -> None:
    folder = laboratory(tmp_path / "lab", lab)
    text = (folder / "rig.toml").read_text().replace("match_s = 20.0", "match_s = 0.3")
    (folder / "rig.toml").write_text(text)
    ran = inside(rig, "play", "run.csv", "--out", "bags", "--arm", cwd=folder)
    assert ran.returncode == 1
    assert said in ran.stderr
    assert len(ran.stderr.splitlines()) == 1
