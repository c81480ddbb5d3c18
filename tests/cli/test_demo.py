"""`irt demo` as a user runs it: a process of its own, in an empty folder."""

import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest

from irt.cli.__main__ import main
from irt.cli.demo import data
from irt.model import load_model
from irt.report.tuning_report import untuned
from irt.report.words import percent
from irt.residual import evaluate
from irt.rig import load_rig


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    command = [sys.executable, "-m", "irt.cli", "demo", "--starts", "3", "--seed", "5"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=180, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "irt-demo", done


@pytest.fixture(scope="module")
def page(demo):
    return (demo[0] / "report.html").read_text(encoding="utf-8")


def test_it_ends_by_naming_the_report_and_draws_no_bar_into_a_pipe(demo):
    folder, done = demo
    assert done.stdout.splitlines()[-1].split() == ["report", "irt-demo/report.html"]
    assert done.stderr == ""
    assert (folder / "report.html").is_file()


def test_tuned_model_predicts_runs_that_it_never_saw(demo):
    model = load_model(demo[0] / "model.toml")
    for name, share in (("labyrinth", 0.2), ("labyrinth-heldout", 0.3)):
        rig = load_rig(data(name))
        before, after = (evaluate(m, rig.recordings).free_run.mae for m in (untuned(rig), model))
        assert after < share * before


def test_what_the_recordings_do_pin_down_is_found(demo):
    """The ratio of the gears and the observation scale, as benches/record_pybullet.py set them."""
    gear_x, gear_y, _, _, observation_scale = load_model(demo[0] / "model.toml").values
    assert gear_x / gear_y == pytest.approx(0.038 / 0.068, rel=0.15)
    assert observation_scale == pytest.approx(1.06, abs=0.05)


def test_page_tells_what_evaluation_finds(demo, page):
    evaluation = evaluate(load_model(demo[0] / "model.toml"), load_rig(data("labyrinth-heldout")).recordings)
    for run in evaluation.runs:
        row = re.search(rf'<th scope="row">{run.recording}</th>(.*?)</tr>', page)
        assert row is not None
        assert f"<td>{percent(run.free_run.mae)}</td>" in row[1]
    assert percent(evaluation.free_run.mae) in page


def test_page_says_how_to_do_the_same_again(page):
    assert "<dd>irt demo --out irt-demo --seed 5 --starts 3</dd>" in page
    for package in ("labsim-irt", "numpy", "torch"):
        assert re.search(rf"{package} \d+\.\d+", page)
    assert "from 3 starts" in page


def test_page_stands_alone(page):
    class Sources(HTMLParser):
        found: list[str]

        def handle_starttag(self, tag, attrs):
            self.found += [value for name, value in attrs if name in {"src", "href", "xlink:href", "data"}]

    sources = Sources()
    sources.found = []
    sources.feed(page)
    assert sources.found
    assert all(source.startswith(("#", "data:")) for source in sources.found)
    assert "/tmp" not in page


def test_same_seed_gives_the_same_model(demo, tmp_path, capsys):
    assert main(["demo", "--starts", "3", "--seed", "5", "--out", f"{tmp_path / 'again'}"]) == 0
    one, again = (load_model(folder / "model.toml") for folder in (demo[0], tmp_path / "again"))
    np.testing.assert_array_equal(one.values, again.values)


@pytest.mark.parametrize("words", [["--starts", "0"], ["--starts", "two"], ["--seed", "-1"]])
def test_wrong_numbers_are_wrong_usage(words, capsys):
    with pytest.raises(SystemExit) as exit_:
        main(["demo", *words])
    assert exit_.value.code == 2
    assert "expected a whole number from" in capsys.readouterr().err


def test_unwritable_output_is_told_before_the_work(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["demo", "--out", f"{tmp_path / 'file'}"]) == 1
    assert "file" in capsys.readouterr().err
