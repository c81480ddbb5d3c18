"""`irt reproduce` as a user runs it; results of the experiments are tested elsewhere."""

import argparse
import shlex
import sys

import pytest

from irt.cli import reproduce as verb


def parsed(words):
    parser = argparse.ArgumentParser()
    verb.add_arguments(parser)
    return parser.parse_args(words)


def test_a_figure_that_needs_no_experiment_comes_at_once(irt, tmp_path):
    done = irt("reproduce", "symmetry", "--out", tmp_path / "out", "--threads", 1)
    assert done.status == 0
    assert (tmp_path / "out" / "paper" / "symmetry.png").stat().st_size > 5_000
    assert done.out.splitlines()[-1] == f"wrote {tmp_path / 'out' / 'paper'}"


def test_the_second_experiment_says_what_it_needs(irt, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    done = irt("reproduce", "fig8", "--out", tmp_path)
    assert done.status == 1
    assert "labsim-irt[prove]" in done.err


@pytest.mark.parametrize("words", [["fig9"], ["--targets", "1"], ["--ablations", "-1"]])
def test_what_cannot_be_is_a_wrong_usage(irt, tmp_path, words):
    assert irt("reproduce", *words, "--out", tmp_path).status == 2


@pytest.mark.parametrize(
    "words",
    [
        ["--full", "--real", "a rig", "--page", "docs/paper.md"],
        ["--targets", "7", "--ablations", "0", "--damping", "--literal-drive", "--seed", "3"],
    ],
)
def test_the_command_on_the_page_asks_for_the_same(words):
    asked = parsed(words)
    program, verbs_name, *again = shlex.split(verb._command(asked))
    assert (program, verbs_name) == ("irt", verb.NAME)
    assert parsed(again) == asked


def test_full_means_more_of_each():
    quick, full = (verb._counts(parsed(words)) for words in ([], ["--full"]))
    assert all(quick[name] < full[name] for name in quick)
    assert verb._counts(parsed(["--full", "--rigs", "5"])) == {**full, "rigs": 5}
