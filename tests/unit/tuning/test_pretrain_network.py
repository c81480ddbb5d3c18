"""Training, its checkpoints and its resumption; `irt pretrain` itself is tested in tests/cli."""

import json

import pytest
import torch

from irt.errors import IrtError
from irt.tuning.drive import Drive
from irt.tuning.pretrain import CHECKPOINT_EPOCHS, pretrain
from irt.tuning.tensors import checkpoint_path, read_tensors, write_tensors
from irt.tuning.tunenet import load_network


def stop_after(epochs):
    """Return a progress that ends the training as Ctrl-C does."""

    def progress(done, total, text):
        if text.startswith("training") and done == epochs:
            raise KeyboardInterrupt

    return progress


@pytest.fixture
def stopped(small_drive, recipe, tmp_path):
    """Return the file of a training that was stopped after seven of twelve epochs."""
    path = tmp_path / "stopped.safetensors"
    with pytest.raises(KeyboardInterrupt):
        pretrain(small_drive, path, recipe(), progress=stop_after(7))
    assert not path.exists()
    return path


def test_the_same_seed_gives_the_same_bytes(small_drive, recipe, tmp_path):
    files = [tmp_path / name for name in ("a", "b", "c")]
    for path, seed, threads in zip(files, (0, 0, 1), (1, 2, 1), strict=True):
        pretrain(small_drive, path, recipe(seed=seed), threads=threads)
    a, b, c = (path.read_bytes() for path in files)
    assert a == b
    assert a != c


@pytest.mark.parametrize(
    "changes", [{}, {"dealing": "once", "schedule": "constant", "noise": (0.0, 0.0)}], ids=["ours", "paper's"]
)
def test_a_resumed_training_ends_with_the_same_bytes(small_drive, recipe, tmp_path, changes):
    whole, resumed = tmp_path / "whole.safetensors", tmp_path / "resumed.safetensors"
    pretrain(small_drive, whole, recipe(**changes))
    with pytest.raises(KeyboardInterrupt):
        pretrain(small_drive, resumed, recipe(**changes), progress=stop_after(7))
    steps = []
    pretrain(small_drive, resumed, recipe(**changes), resume=True, progress=lambda *step: steps.append(step))
    trained = [done for done, _, text in steps if text.startswith("training")]
    assert trained == list(range(CHECKPOINT_EPOCHS + 1, 13))
    assert resumed.read_bytes() == whole.read_bytes()
    assert not checkpoint_path(resumed).exists()


def test_a_checkpoint_takes_part_in_no_network(stopped):
    with pytest.raises(IrtError, match="not a trained network"):
        load_network(checkpoint_path(stopped))


def test_without_resume_training_begins_anew(small_drive, recipe, stopped, tmp_path):
    other = tmp_path / "other.safetensors"
    pretrain(small_drive, stopped, recipe())
    pretrain(small_drive, other, recipe())
    assert stopped.read_bytes() == other.read_bytes()


def test_nothing_to_resume_is_reported(small_drive, recipe, tmp_path):
    with pytest.raises(IrtError, match=r"net\.checkpoint\.safetensors: no such file"):
        pretrain(small_drive, tmp_path / "net.safetensors", recipe(), resume=True)


def test_a_checkpoint_of_another_training_is_refused(small_drive, recipe, stopped):
    with pytest.raises(IrtError, match="of another training: its recipe is"):
        pretrain(small_drive, stopped, recipe(seed=1), resume=True)
    with pytest.raises(IrtError, match="of another training: its drive is"):
        pretrain(Drive.paper(), stopped, recipe(), resume=True)


def test_a_truncated_checkpoint_is_refused(small_drive, recipe, stopped):
    checkpoint = checkpoint_path(stopped)
    checkpoint.write_bytes(checkpoint.read_bytes()[:-100])
    with pytest.raises(IrtError, match="cut short"):
        pretrain(small_drive, stopped, recipe(), resume=True)


def test_a_checkpoint_that_lacks_a_moment_is_refused(small_drive, recipe, stopped):
    checkpoint = checkpoint_path(stopped)
    tensors, metadata = read_tensors(checkpoint)
    del tensors["adam.exp_avg.joined.weight"]
    write_tensors(checkpoint, tensors, metadata)
    with pytest.raises(IrtError, match=r"lacks 'adam\.exp_avg\.joined\.weight'"):
        pretrain(small_drive, stopped, recipe(), resume=True)


def test_the_file_says_what_made_it(small_drive, recipe, tmp_path):
    path = tmp_path / "net.safetensors"
    made = pretrain(small_drive, path, recipe(seed=3), command="irt pretrain --seed 3")
    read = load_network(path)
    assert read.metadata == {"format": "irt-tunenet-1", **made.metadata}
    assert read.metadata["drive"] == small_drive.digest
    assert read.metadata["command"] == "irt pretrain --seed 3"
    assert (read.metadata["seed"], read.metadata["pairs"], read.metadata["epochs"]) == ("3", "60", "12")
    assert json.loads(read.metadata["ranges"])["time_scale"] == [0.0, 50.0]
    assert len(read.metadata["data"]) == 64
    assert float(read.metadata["heldout_loss"]) == pytest.approx(float(read.heldout[-1]), rel=1e-5)
    assert len(read.training) == len(read.heldout) == 12


@pytest.mark.slow
def test_training_learns(small_drive, recipe, tmp_path):
    made = pretrain(small_drive, tmp_path / "net", recipe(pairs=600, epochs=20))
    # Always saying "no difference" has the loss of a difference of two uniform numbers, 1/6.
    assert made.heldout[-1] < 0.7 / 6
    assert made.heldout[-1] < 0.85 * made.heldout[0]


@pytest.mark.slow
def test_training_leaves_the_settings_of_torch_alone(small_drive, recipe, tmp_path):
    threads = torch.get_num_threads()
    torch.manual_seed(11)
    expected = torch.rand(3)
    torch.manual_seed(11)
    pretrain(small_drive, tmp_path / "net", recipe(epochs=1))
    assert torch.equal(torch.rand(3), expected)
    assert torch.get_num_threads() == threads
    assert not torch.are_deterministic_algorithms_enabled()


@pytest.mark.parametrize("name", ["pairs", "epochs", "batch"])
def test_a_recipe_needs_at_least_one_of_each(recipe, name):
    with pytest.raises(IrtError, match=f"{name} must be at least 1, not 0"):
        recipe(**{name: 0})


@pytest.mark.parametrize(
    ("name", "message"), [("", "is a folder"), ("file/net", "the folder cannot be made")]
)
def test_an_output_that_cannot_be_written_is_refused_before_the_work(
    small_drive, recipe, tmp_path, name, message
):
    (tmp_path / "file").touch()
    steps = []
    with pytest.raises(IrtError, match=message):
        pretrain(small_drive, tmp_path / name, recipe(), progress=lambda *step: steps.append(step))
    assert not steps
