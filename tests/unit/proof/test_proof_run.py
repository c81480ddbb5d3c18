"""A proof from end to end with a small world: what is published when, what resumes, what is caught."""

from __future__ import annotations

import json
import stat
import sys
from pathlib import Path

import pytest

from irt.errors import IrtError
from irt.proof.hash_chain import Places, manifest, verify
from irt.proof.pipe import Pipe
from irt.proof.plan import Plan
from irt.proof.seal import canonical
from irt.proof.sealing import command


def test_the_chain_holds(places: Places) -> None:
    assert verify(places.out) == 3
    label = json.loads((places.opened("rig-0001") / "label.json").read_text())
    assert label["truth"]["gear_x"] == 0.06
    assert sorted(path.name for path in places.opened("rig-0001").iterdir()) == [
        "label.json",
        "test-1.csv",
        "test-2.csv",
    ]
    assert sorted(path.name for path in places.rig("rig-0001").iterdir()) == [
        "rig.toml",
        "train-1.csv",
        "train-2.csv",
        "train-3.csv",
    ]


def test_commitments_are_out_before_and_keys_after_the_answers(prove, hat, tmp_path: Path) -> None:
    """The hat sees recordings alone, and what the folder holds while it answers."""
    places, seen = Places(tmp_path / "proof"), []

    class Watching:
        def each(self, name, inputs):
            for rig, answer in hat().each(name, inputs):
                seen.append((places.commitments.exists(), places.keys.exists(), set(inputs[rig])))
                yield rig, answer

    prove(Watching())
    recordings = {"rig.toml", "train-1.csv", "train-2.csv", "train-3.csv"}
    assert seen == [(True, False, recordings)] * 3


@pytest.mark.slow
def test_the_same_seed_hides_the_same(prove, files, tmp_path: Path) -> None:
    first = files(prove().out / "rigs")
    (tmp_path / "proof").rename(tmp_path / "first")
    assert files(prove().out / "rigs") == first
    (tmp_path / "proof").rename(tmp_path / "second")
    assert files(prove(seed=6).out / "rigs") != first


def test_kinds_are_shuffled_by_the_seed_alone() -> None:
    plan = Plan.of(20, 20)
    assert plan.order(1) == plan.order(1) != plan.order(2)
    assert sorted(plan.order(1)) == sorted(plan.order(2))
    assert (plan.rigs, plan.nulls) == (40, 20)
    assert Plan.of(300, 300).as_dict() == {
        "none": 270,
        "outliers": 30,
        "single": 180,
        "pair": 60,
        "unlisted": 60,
        "first": 0,
    }
    with pytest.raises(IrtError, match="at least one rig"):
        Plan.of(0, 0)


def test_it_goes_on_where_it_was_stopped(prove, hat, files, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        prove(hat(stop=1))
    before = files(tmp_path / "proof")
    going_on = hat()
    places = prove(going_on)
    assert going_on.asked == ["rig-0002", "rig-0003"]
    after = files(places.out)
    assert {name: after[name] for name in before} == before
    again = hat()
    prove(again)
    assert again.asked == []
    assert files(places.out)["keys.json"] == after["keys.json"]


def test_nothing_goes_on_behind_a_stop(prove, hat) -> None:
    """Whoever stops while an answer is written down leaves no diagnosis running."""
    ended = []

    class Watching:
        def each(self, name, inputs):
            try:
                yield from hat().each(name, inputs)
            finally:
                ended.append(name)

    def stop(_done: int, _total: int, text: str) -> None:
        if text == "diagnosed: 2 of 3":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        prove(Watching(), progress=stop)
    assert ended == ["irt.proof.blind"]
    assert stopped.value is not None


def test_rigs_half_made_are_made_again(prove, files, monkeypatch, tmp_path: Path) -> None:
    whole = Pipe.ask

    def stop_at_third(pipe, request):
        if request.get("make", {}).get("index") == 2:
            raise KeyboardInterrupt
        return whole(pipe, request)

    monkeypatch.setattr(Pipe, "ask", stop_at_third)
    with pytest.raises(KeyboardInterrupt):
        prove()
    monkeypatch.undo()
    places = Places(tmp_path / "proof")
    assert not places.commitments.exists()
    sealed = files(places.out / "seals")
    (places.rig("rig-0003") / "train-9.csv").write_text("half")
    prove()
    assert {name: files(places.out / "seals")[name] for name in sealed} == sealed
    assert not (places.rig("rig-0003") / "train-9.csv").exists()
    assert verify(places.out) == 3


def test_many_hands_hide_the_same(prove, places: Places, files, tmp_path: Path) -> None:
    recordings = files(places.out / "rigs")
    places.out.rename(tmp_path / "first")
    many = prove(hiders=3)
    assert files(many.out / "rigs") == recordings
    assert verify(many.out) == 3


@pytest.mark.usefixtures("places")
def test_another_plan_or_seed_is_another_proof(prove) -> None:
    for other in ({"plan": Plan(none=2)}, {"seed": 6}):
        with pytest.raises(IrtError, match="holds a proof of another plan or seed"):
            prove(**other)
    prove(seed=None)


def test_the_vault_is_its_owners_alone(prove) -> None:
    places = prove(seed=None)
    assert stat.S_IMODE(places.vault.stat().st_mode) == 0o700
    assert json.loads((places.vault / "secret.json").read_text())["seed"] > 0


def altered_answer(places: Places) -> None:
    (places.answer("rig-0002") / "diagnosis.json").write_text("{}")


def answer_more(places: Places) -> None:
    (places.answer("rig-0002") / "plausible-2.toml").write_text("")


def altered_recording(places: Places) -> None:
    path = places.rig("rig-0002") / "train-1.csv"
    path.write_text(path.read_text().replace("1", "2"))


def altered_opened_label(places: Places) -> None:
    path = places.opened("rig-0002") / "label.json"
    path.write_text(path.read_text().replace("0.06", "0.07"))


def exchanged_seals(places: Places) -> None:
    one, other = (json.loads(places.seal(name).read_text()) for name in ("rig-0001", "rig-0002"))
    places.seal("rig-0002").write_bytes(canonical({**one, "rig": "rig-0002"}))
    places.seal("rig-0001").write_bytes(canonical({**other, "rig": "rig-0001"}))


def altered_nonce(places: Places) -> None:
    keys = json.loads(places.keys.read_text())
    keys["keys"]["rig-0002"]["nonce"] = "00" * 32
    places.keys.write_bytes(canonical(keys))


def altered_answer_and_manifest(places: Places) -> None:
    altered_answer(places)
    places.manifest.write_bytes(canonical(manifest(places, ["rig-0001", "rig-0002", "rig-0003"])))


def altered_commitment(places: Places) -> None:
    published = json.loads(places.commitments.read_text())
    published["commitments"]["rig-0002"] = "00" * 32
    places.commitments.write_bytes(canonical(published))


@pytest.mark.parametrize(
    ("alter", "message"),
    [
        (altered_answer, "rig-0002: the answer is not the one of the manifest"),
        (answer_more, "rig-0002: the answer is not the one of the manifest"),
        (altered_recording, "rig-0002: its recordings are not those that were sealed"),
        (altered_opened_label, "rig-0002: the label that was opened is not the one that was sealed"),
        (exchanged_seals, "rig-0001: the seal carries another commitment"),
        (altered_nonce, "rig-0002: the label does not fit its commitment"),
        (altered_answer_and_manifest, "manifest.json: not the one that the keys were released for"),
        (altered_commitment, "commitments.json: not what the manifest says"),
    ],
)
def test_what_was_altered_is_caught(places: Places, alter, message: str) -> None:
    alter(places)
    with pytest.raises(IrtError, match=message) as caught:
        verify(places.out)
    assert "\n" not in str(caught.value)


def test_the_keys_go_out_for_one_manifest(places: Places, prove) -> None:
    """Nobody can open the seals, change an answer, and come again."""
    altered_answer_and_manifest(places)
    with pytest.raises(IrtError, match="the keys were released for other answers"):
        prove()


def test_no_key_without_all_answers(world, tmp_path: Path) -> None:
    with Pipe(command(tmp_path / "vault", Plan(none=1), 0, world), "the sealing process") as sealer:
        made = sealer.ask({"make": {"index": 0, "folder": str(tmp_path)}})
        assert set(made) == {"rig", "commitment", "sealed"}
        with pytest.raises(IrtError, match="rig-0001: the manifest has no answer"):
            sealer.ask({"release": {"manifest": {"answers": {}}}})
        with pytest.raises(IrtError, match="unknown request: open"):
            sealer.ask({"open": {}})


def test_a_world_that_fails_is_one_clear_line(tmp_path: Path) -> None:
    for world, message in (
        ([sys.executable, "-c", "pass"], "the concealed world ended before it answered"),
        ([str(tmp_path / "none")], "the concealed world cannot be started"),
        ([sys.executable, "-c", 'print(\'{"error": "no marble"}\')'], "^no marble$"),
    ):
        with (
            Pipe(command(tmp_path / "vault", Plan(none=1), 0, world), "the sealing process") as sealer,
            pytest.raises(IrtError, match=message),
        ):
            sealer.ask({"make": {"index": 0, "folder": str(tmp_path)}})
