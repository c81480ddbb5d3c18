"""`irt demo` as a user runs it: a process of its own, in an empty folder."""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser

import pytest

from irt.cli.__main__ import main
from irt.cli.demo import data
from irt.model import load_model
from irt.residual import evaluate
from irt.rig import load_rig

PAGES = ("report.html", "tuned/report.html")


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    command = [sys.executable, "-m", "irt.cli", "demo", "--seed", "5"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=180, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "irt-demo", done


@pytest.fixture(scope="module")
def diagnosis(demo):
    return json.loads((demo[0] / "diagnosis.json").read_text())


@pytest.mark.slow
def test_it_opens_with_what_was_found_and_ends_by_naming_the_pages(demo, diagnosis):
    folder, done = demo
    lines = done.stdout.splitlines()
    assert lines[0] == diagnosis["summary"]
    assert "backlash" in lines[0].lower()
    assert [line.split() for line in lines[-3:]] == [
        ["recordings", "irt-demo/demo-rig"],
        ["tuning", "irt-demo/tuned/report.html"],
        ["diagnosis", "irt-demo/report.html"],
    ]
    assert done.stderr == ""  # no progress bar into a pipe
    assert all((folder / page).is_file() for page in PAGES)


@pytest.mark.slow
def test_the_next_step_it_names_can_be_taken(demo, diagnosis):
    (named,) = re.findall("`irt suggest (.*) --models DIR`", diagnosis["suggestion"])
    assert named == "irt-demo/demo-rig"
    assert load_rig(demo[0].parent / named).digest == load_rig(data("demo-rig")).digest


@pytest.mark.slow
def test_the_hidden_backlash_is_found_with_its_size(diagnosis):
    """The truth is that of benches/record_demo.py."""
    (effect,) = diagnosis["effects"]
    assert (diagnosis["verdict"], effect["name"]) == ("missing", "backlash")
    for name, truth in (("width_x_rad", 0.04), ("width_y_rad", 0.06)):
        assert effect["parameters"][name]["value"] == pytest.approx(truth, rel=0.02)


@pytest.mark.slow
def test_diagnosed_model_predicts_better_than_the_tuned_one(demo):
    rig = load_rig(data("demo-rig"))
    tuned, diagnosed = (
        evaluate(load_model(demo[0] / path), rig.recordings).mae
        for path in ("tuned/model.toml", "model.toml")
    )
    assert diagnosed < 0.1 * tuned


@pytest.mark.slow
def test_tuning_page_says_how_to_do_the_same_again(demo):
    page = (demo[0] / "tuned" / "report.html").read_text(encoding="utf-8")
    assert "<dd>irt demo --out irt-demo --seed 5</dd>" in page
    assert re.search(r"numpy \d+\.\d+", page)


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_pages_stand_alone(demo, name):
    class Sources(HTMLParser):
        found: list[str]

        def handle_starttag(self, tag, attrs):
            self.found += [value for name, value in attrs if name in {"src", "href", "xlink:href", "data"}]

    sources = Sources()
    sources.found = []
    page = (demo[0] / name).read_text(encoding="utf-8")
    sources.feed(page)
    assert all(source.startswith(("#", "data:")) for source in sources.found)
    assert f"{demo[0]}" not in page


@pytest.mark.parametrize("words", [["--seed", "-1"], ["--seed", "two"]])
def test_wrong_numbers_are_wrong_usage(words, capsys):
    with pytest.raises(SystemExit) as exit_:
        main(["demo", *words])
    assert exit_.value.code == 2
    assert "expected a whole number from" in capsys.readouterr().err


def test_unwritable_output_is_an_error_before_the_work(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["demo", "--out", f"{tmp_path / 'file'}"]) == 1
    assert "file" in capsys.readouterr().err
