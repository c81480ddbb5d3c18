"""The rig beside Fast-DDS, the default of most ROS 2 laboratories, where Debian's package is installed."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest
from laboratory import CONFIG, DEFAULTS, Laboratory

from irt.bag import load_bag

HERE = Path(__file__).resolve().parent
Inside = Callable[..., CompletedProcess[str]]

pytestmark = pytest.mark.slow

#: Starts tracker and arms, runs the rig with the given arguments, and waits for the arms' received commands.
PLAY = 'rig=$1 peer=$2; shift 2; "$peer" 14 & "$rig" "$@"; status=$?; wait $!; exit $status'


@pytest.fixture(scope="module")
def peer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("g++")
    if compiler is None or not Path("/usr/include/fastdds/dds").is_dir():
        pytest.skip("Fast-DDS is not installed: 'apt-get install g++ libfastrtps-dev' adds it")
    program = tmp_path_factory.mktemp("fastdds") / "peer"
    words = [compiler, "-std=c++17", "-O0", HERE / "fastdds.cpp", "-o", program, "-lfastrtps", "-lfastcdr"]
    subprocess.run(words, check=True)
    return program


def test_tracker_and_arms_of_another_vendor_are_heard_and_hear(
    rig: Path, peer: Path, inside: Inside, tmp_path: Path
) -> None:
    laboratory = Laboratory(tmp_path, rig)
    laboratory.write_commands(seconds=4.0)
    text = CONFIG.format_map(DEFAULTS).replace('services = "cyclone"', 'services = "enhanced"')
    (tmp_path / "rig.toml").write_text(text)
    ran = inside(
        "bash", "-c", PLAY, "_", rig, peer, "play", "run.csv", "--out", "bags", "--arm", cwd=tmp_path
    )
    assert ran.returncode == 0, ran.stderr
    bag = load_bag(tmp_path / "bags" / "run.mcap")
    assert bag.measured is not None
    received = [line.split() for line in ran.stdout.splitlines() if "_wrist" in line]
    assert [words[0] for words in received] == ["left_wrist", "right_wrist"]
    for words, positions in zip(received, bag.set_points.values.T, strict=True):
        assert int(words[1]) > 400
        assert abs(float(words[3]) - float(words[2])) == pytest.approx(np.ptp(positions), rel=0.02)
    # The arms' commands came back as joint states, and the marble's points arrived too.
    assert np.ptp(bag.measured.values, axis=0) == pytest.approx(
        np.ptp(bag.set_points.values, axis=0), rel=0.02
    )
    assert bag.marble.stamps.size > 250
