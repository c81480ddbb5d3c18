"""A proof from end to end with a small world: what is published when, what resumes, what is caught."""

from __future__ import annotations

import json
import os
import signal
import stat
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from irt.errors import IrtError
from irt.proof.hash_chain import CHAIN, Places, Secret, release, verify
from irt.proof.plan import WORLDS, Plan
from irt.proof.seal import canonical, digest, digests
from irt.proof.world import World


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


@pytest.mark.parametrize("plan", [Plan.of(20, 20), Plan(single=4, triple=2, none=1)])
def test_each_world_gets_its_third_of_each_kind(plan: Plan) -> None:
    for seed in range(20):
        order = plan.order(seed)
        for kind, count in plan.as_dict().items():
            shares = [order[world::WORLDS].count(kind) for world in range(WORLDS)]
            assert sum(shares) == count
            assert max(shares) - min(shares) <= 1


def test_kinds_are_shuffled_by_the_seed_alone() -> None:
    plan = Plan.of(20, 20)
    assert plan.order(1) == plan.order(1) != plan.order(2)
    assert sorted(plan.order(1)) == sorted(plan.order(2))
    assert plan.rigs == 40
    assert Plan.of(300, 300).as_dict() == {
        "none": 270,
        "outliers": 30,
        "single": 150,
        "pair": 60,
        "triple": 30,
        "unlisted": 60,
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
    whole = World.ask

    def stop_at_third(world, request):
        if request.get("make", {}).get("index") == 2:
            raise KeyboardInterrupt
        return whole(world, request)

    monkeypatch.setattr(World, "ask", stop_at_third)
    with pytest.raises(KeyboardInterrupt):
        prove()
    monkeypatch.undo()
    places = Places(tmp_path / "proof")
    assert not places.commitments.exists()
    sealed = files(places.out / "vault")
    half = places.rig("rig-0003").with_name(".irt-1234abcd")
    half.mkdir()
    (half / "train-9.csv").write_text("half")
    prove()
    assert not half.exists()
    assert len(sealed) == 3
    assert {name: files(places.out / "vault")[name] for name in sealed} == sealed
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


def test_an_unfinished_proof_stays_with_its_code(prove, hat) -> None:
    """Rigs of one proof are diagnosed by one state of the code; a finished proof may be scored by another."""
    with pytest.raises(KeyboardInterrupt):
        prove(hat(stop=1))
    other = {"world": "a small world", "code": "other code", "commit": ""}
    with pytest.raises(IrtError, match="an unfinished proof of this code, and this is other code"):
        prove(provenance=other)
    prove()
    prove(provenance=other)


def test_code_that_changes_under_way_releases_no_key(prove, hat, tmp_path: Path) -> None:
    class Edited:
        def each(self, name, inputs):
            for rig, answer in hat().each(name, inputs):
                yield rig, {**answer, "code.json": b'{"code": "edited code"}'}

    with pytest.raises(IrtError, match="rig-0001: diagnosed by edited code, and the plan is of this code"):
        prove(Edited())
    assert not Places(tmp_path / "proof").keys.exists()


def test_the_vault_is_its_owners_alone(prove) -> None:
    places = prove(seed=None)
    assert stat.S_IMODE(places.secret.parent.stat().st_mode) == 0o700
    assert json.loads(places.secret.read_text())["seed"] > 0


def test_no_file_but_the_vault_says_what_is_hidden(prove, hat, tmp_path: Path) -> None:
    """While rigs are diagnosed neither seed nor label lies in the open."""
    with pytest.raises(KeyboardInterrupt):
        prove(hat(stop=0))
    places = Places(tmp_path / "proof")
    secret = json.loads(places.secret.read_text())
    for path in places.out.rglob("*"):
        if path.is_file() and path.parent != places.secret.parent:
            text = path.read_text()
            assert "parallax" not in text
            assert secret["nonce"] not in text


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


def exchanged_labels(places: Places) -> None:
    one, other = (places.opened(name) for name in ("rig-0001", "rig-0002"))
    one.rename(one.with_name("between"))
    other.rename(one)
    one.with_name("between").rename(other)


def altered_held_out_run(places: Places) -> None:
    path = places.opened("rig-0002") / "test-1.csv"
    path.write_text(path.read_text().replace("1", "2"))


def rewritten(places: Places, name: str, **changed: object) -> None:
    """Change a file of the chain, and all that holds its SHA-256."""
    content = json.loads((places.out / name).read_text())
    (places.out / name).write_bytes(canonical({**content, **changed}))
    for before, after in pairwise(CHAIN):
        content = json.loads((places.out / after).read_text())
        content[Path(before).stem] = digest((places.out / before).read_bytes())
        (places.out / after).write_bytes(canonical(content))


def another_nonce(places: Places) -> None:
    rewritten(places, "keys.json", nonce="00" * 32)


def another_seed(places: Places) -> None:
    """Another seed would give the rigs other kinds."""
    rewritten(places, "keys.json", seed=6)


def fewer_rigs(places: Places) -> None:
    """A rig that failed is left out of the plan afterwards."""
    rewritten(places, "plan.json", plan={**Plan(none=1, single=1).as_dict()})


def another_kind(places: Places) -> None:
    rewritten(places, "plan.json", plan={**Plan(none=2, single=1).as_dict()})


def altered_answer_and_manifest(places: Places) -> None:
    altered_answer(places)
    content = json.loads(places.manifest.read_text())
    content["answers"]["rig-0002"] = digests(places.answer("rig-0002"))
    places.manifest.write_bytes(canonical(content))


def altered_commitment(places: Places) -> None:
    published = json.loads(places.commitments.read_text())
    published["commitments"]["rig-0002"] = "00" * 32
    places.commitments.write_bytes(canonical(published))


def another_code(places: Places) -> None:
    content = json.loads(places.plan.read_text())
    places.plan.write_bytes(canonical({**content, "code": "better code"}))


@pytest.mark.parametrize(
    ("alter", "message"),
    [
        (altered_answer, "rig-0002: the answer is not the one of the manifest"),
        (answer_more, "rig-0002: the answer is not the one of the manifest"),
        (altered_recording, "rig-0002: its recordings are not those that were committed to"),
        (altered_opened_label, "rig-0002: the label does not fit its published commitment"),
        (altered_held_out_run, "rig-0002: the held-out runs are not those of the label"),
        (exchanged_labels, "rig-0001: the label does not fit its published commitment"),
        (another_nonce, "keys.json: not the seed that the plan is committed to"),
        (another_seed, "keys.json: not the seed that the plan is committed to"),
        (fewer_rigs, "commitments.json: not the rigs of the plan"),
        (another_kind, "its label is not of the kind that plan and seed give it"),
        (another_code, "plan.json: not the one that commitments.json is of"),
        (altered_answer_and_manifest, "manifest.json: not the one that keys.json is of"),
        (altered_commitment, "commitments.json: not the one that manifest.json is of"),
    ],
)
def test_what_was_altered_is_caught(places: Places, alter, message: str) -> None:
    alter(places)
    with pytest.raises(IrtError, match=message) as caught:
        verify(places.out)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("gone", [("keys.json",), ("keys.json", "manifest.json"), CHAIN[1:]])
def test_an_unfinished_proof_is_named(places: Places, gone: tuple[str, ...]) -> None:
    for name in gone:
        (places.out / name).unlink()
    with pytest.raises(IrtError, match=r"not finished: no .* yet, 3 of 3 rigs"):
        verify(places.out)


def test_the_published_files_are_checked_alone(places: Places, tmp_path: Path) -> None:
    """Whoever has the page's files can check them without recordings and answers."""
    published = tmp_path / "published"
    published.mkdir()
    for name in CHAIN:
        (published / name).write_bytes((places.out / name).read_bytes())
    assert verify(published) == 3
    for alter in (another_seed, altered_commitment, another_code):
        kept = {name: (published / name).read_bytes() for name in CHAIN}
        alter(Places(published))
        with pytest.raises(IrtError):
            verify(published)
        for name, data in kept.items():
            (published / name).write_bytes(data)


def test_the_key_goes_out_for_one_manifest(places: Places, prove) -> None:
    """Nobody can open the seals, change an answer, and come again."""
    altered_answer_and_manifest(places)
    with pytest.raises(IrtError, match=r"manifest\.json: not the one that keys\.json is of"):
        prove()


def test_no_key_without_all_answers(places: Places) -> None:
    for name in ("keys.json", "manifest.json", "answers/rig-0002/diagnosis.json"):
        (places.out / name).unlink()
    places.answer("rig-0002").rename(places.out / "elsewhere")
    names = ["rig-0001", "rig-0002", "rig-0003"]
    with pytest.raises(IrtError, match="rig-0002: there is no answer; the key is not released"):
        release(places, names, Secret(**json.loads(places.secret.read_text())))
    assert not places.keys.exists()


def test_a_world_that_fails_midway_leaves_no_half_written_rig(prove, tmp_path: Path) -> None:
    half = (
        "import json, pathlib; asked = json.loads(input())['make'];"
        "pathlib.Path(asked['folder'], 'train-1.csv').write_text('step,'); raise SystemExit(1)"
    )
    with pytest.raises(IrtError, match="ended before it answered"):
        prove(world=[sys.executable, "-c", half])
    assert list((tmp_path / "proof" / "rigs").iterdir()) == []


def test_a_world_that_fails_is_one_clear_line(tmp_path: Path) -> None:
    for command, message in (
        ([sys.executable, "-c", "pass"], "the program that makes the rigs ended before it answered"),
        ([str(tmp_path / "none")], "the program that makes the rigs cannot be started"),
        ([sys.executable, "-c", 'print(\'{"error": "no marble"}\')'], "^no marble$"),
    ):
        with pytest.raises(IrtError, match=message), World(command) as world:
            world.ask({"make": {"index": 0, "folder": str(tmp_path)}})


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="this system has no process groups")
def test_a_world_that_ends_while_it_is_stopped_is_no_error(monkeypatch) -> None:
    """A thread that waits for the world may take its number away just before the signal."""
    kill = os.killpg

    def too_late(group: int, number: int) -> None:
        kill(group, signal.SIGKILL)
        os.waitpid(group, 0)
        kill(group, number)

    monkeypatch.setattr(os, "killpg", too_late)
    with World([sys.executable, "-c", "input()"]) as world:
        world.stop()
