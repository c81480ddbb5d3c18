"""`irt pretrain` as a user runs it."""

import argparse
import signal
import subprocess
import sys
import time

import pytest

from irt.cli import pretrain as verb
from irt.tuning import pretrain as training
from irt.tuning import recipes, streaming
from irt.tuning.drive import Drive
from irt.tuning.recipes import Recipe
from irt.tuning.stepnet import load_steps
from irt.tuning.tensors import checkpoint_path
from irt.tuning.tunenet import load_network

FEW = ("--pairs", "50", "--epochs", "6")


@pytest.mark.slow
def test_it_writes_a_network_and_its_loss_curve(irt, tmp_path):
    out = tmp_path / "new" / "net.safetensors"
    done = irt("pretrain", *FEW, "--seed", "3", "--out", out)
    assert (done.status, done.err) == (0, "")
    file = load_network(out)
    assert file.metadata["drive"] == Drive.paper().digest
    assert file.metadata["command"] == "irt pretrain --pairs 50 --epochs 6 --seed 3 --engine rolling"
    assert "50 training, 5 held out" in done.out
    assert f"{file.heldout[-1]:.5f} held out" in done.out
    assert (tmp_path / "new" / "net-loss.svg").read_text().startswith("<?xml")
    assert done.out.splitlines()[-1] == f"wrote {out} and {tmp_path / 'new' / 'net-loss.svg'}"


@pytest.mark.slow
def test_the_command_it_recorded_makes_the_same_network_again(irt, tmp_path):
    first, second = tmp_path / "a.safetensors", tmp_path / "b.safetensors"
    irt("pretrain", *FEW, "--literal-drive", "--out", first)
    command = load_network(first).metadata["command"].split()
    assert irt(*command[1:], "--out", second).status == 0
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.slow
def test_a_rig_decides_the_drive(irt, write_rig, wave, tmp_path):
    rig = write_rig({"a": (wave, 0 * wave), "b": (wave[:30], 0 * wave[:30])})
    out = tmp_path / "net.safetensors"
    assert irt("pretrain", *FEW, "--rig", rig, "--out", out).status == 0
    assert load_network(out).network.inputs == 2 * (40 + 30)


def test_a_rig_has_no_literal_drive(irt, tmp_path):
    done = irt("pretrain", "--rig", tmp_path, "--literal-drive")
    assert done.status == 2
    assert "not allowed with" in done.err


@pytest.mark.parametrize("words", [("--pairs", "0"), ("--epochs", "two"), ("--seed", "-1")])
def test_numbers_that_cannot_be_are_wrong_usage(irt, words):
    done = irt("pretrain", *words)
    assert done.status == 2
    assert "expected a whole number from" in done.err


def test_nothing_to_resume_takes_one_line(irt, tmp_path):
    done = irt("pretrain", *FEW, "--resume", "--out", tmp_path / "net.safetensors")
    assert done.status == 1
    assert done.err == f"irt: {tmp_path / 'net.checkpoint.safetensors'}: no such file\n"


@pytest.mark.slow
def test_other_options_than_before_take_one_line(irt, tmp_path, monkeypatch):
    out = tmp_path / "net.safetensors"
    stopped(irt, monkeypatch, "--out", out)
    done = irt("pretrain", "--pairs", "51", "--epochs", "8", "--resume", "--out", out)
    assert done.status == 1
    assert "of another training" in done.err
    assert done.err.count("\n") == 1


@pytest.mark.slow
def test_interrupted_it_says_how_to_go_on(irt, tmp_path, monkeypatch):
    out, whole = tmp_path / "with space.safetensors", tmp_path / "whole.safetensors"
    done = stopped(irt, monkeypatch, "--out", out)
    assert done.status == 130
    hint = done.err.splitlines()[0]
    assert f"{checkpoint_path(out)} holds the training so far" in hint
    assert hint.endswith(f"--out '{out}' --resume")
    assert irt("pretrain", "--pairs", "50", "--epochs", "8", "--resume", "--out", out).status == 0
    irt("pretrain", "--pairs", "50", "--epochs", "8", "--out", whole)
    assert out.read_bytes() == whole.read_bytes()


def stopped(irt, monkeypatch, *words):
    """Run a training of eight epochs that Ctrl-C ends after the sixth."""
    run_epoch = training._Training.run_epoch

    def interrupted(self):
        if self.epoch == 6:
            raise KeyboardInterrupt
        run_epoch(self)

    with monkeypatch.context() as patch:
        patch.setattr(training._Training, "run_epoch", interrupted)
        return irt("pretrain", "--pairs", "50", "--epochs", "8", *words)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a kill is a signal")
def test_killed_outright_it_goes_on_to_the_same_bytes(irt, tmp_path):
    out, whole = tmp_path / "net.safetensors", tmp_path / "whole.safetensors"
    words = ("pretrain", "--pairs", "200", "--epochs", "30", "--seed", "1")
    process = subprocess.Popen([sys.executable, "-m", "irt.cli", *words, "--out", str(out)])
    deadline = time.monotonic() + 120
    while not checkpoint_path(out).exists() and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not out.exists()
    assert irt(*words, "--resume", "--out", out).status == 0
    irt(*words, "--out", whole)
    assert out.read_bytes() == whole.read_bytes()


def test_defaults_are_the_papers():
    parser = argparse.ArgumentParser()
    verb.add_arguments(parser)
    args = parser.parse_args([])
    assert (args.method, args.engine, args.literal_drive) == ("irt", "rolling", False)
    assert (Recipe().pairs, Recipe().epochs) == (10_000, 200)


@pytest.fixture
def small(monkeypatch):
    """Let a pool of irt+ be small."""
    for module in (recipes, streaming):
        monkeypatch.setattr(module, "POOL", 64)
    monkeypatch.setattr(streaming, "CHECKPOINT_POOLS", 2)


@pytest.mark.slow
def test_the_network_of_irt_plus_is_streamed(irt, tmp_path, small):
    out = tmp_path / "steps.safetensors"
    done = irt("pretrain", "--method", "irt+", "--pairs", "300", "--seed", "3", "--out", out)
    assert (done.status, done.err) == (0, "")
    file = load_steps(out)
    command = "irt pretrain --method irt+ --pairs 300 --seed 3 --engine rolling"
    assert file.metadata["command"] == command
    assert "384 training, 384 rollouts" in done.out
    assert (tmp_path / "steps-loss.svg").is_file()
    irt(*command.split()[1:], "--out", tmp_path / "again.safetensors")
    assert (tmp_path / "again.safetensors").read_bytes() == out.read_bytes()


@pytest.mark.slow
def test_a_streamed_training_goes_on_to_the_same_bytes(irt, tmp_path, monkeypatch, small):
    words = ("pretrain", "--method", "irt+", "--pairs", "640")
    run_pool = streaming._Training.run_pool

    def interrupted(self):
        if self.pool == 3:
            raise KeyboardInterrupt
        run_pool(self)

    out, whole = tmp_path / "a.safetensors", tmp_path / "b.safetensors"
    with monkeypatch.context() as patch:
        patch.setattr(streaming._Training, "run_pool", interrupted)
        assert irt(*words, "--out", out).status == 130
    assert irt(*words, "--resume", "--out", out).status == 0
    irt(*words, "--out", whole)
    assert out.read_bytes() == whole.read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--method", "irt+", "--epochs", "3"), "--epochs belongs to --method irt or direct"),
        (("--device", "abacus"), "no device abacus here"),
    ],
)
def test_what_does_not_fit_takes_one_line(irt, tmp_path, words, message):
    done = irt("pretrain", *words, "--out", tmp_path / "net.safetensors")
    assert (done.status, done.err.count("\n")) == (1, 1)
    assert message in done.err
