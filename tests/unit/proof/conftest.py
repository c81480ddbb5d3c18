"""A concealed world of a few rows, answers out of a hat, and scores made by hand."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from irt.model import Effect, Model, save_model
from irt.proof.hash_chain import Places, write_folder
from irt.proof.plan import Plan
from irt.proof.run import Proof
from irt.proof.score import Errors, RigScore
from irt.rig import load_rig
from irt.workers import Files

PROVENANCE = {"world": "a small world", "code": "this code", "commit": ""}
WORLD = [sys.executable, str(Path(__file__).with_name("fake_world.py"))]
#: Base values of the fake world.
VALUES = (0.06, 0.05, 4e-4, 15.0, 1.03)
PARALLAX = Effect("parallax", {"height_m_per_rad": 0.5})


def answered(folder: Path, effects: tuple[Effect, ...] = ()) -> dict[str, bytes]:
    """Return what a diagnosis writes that names these effects, the five parameters being right."""
    rig = load_rig(folder)
    save_model(folder / "base.toml", Model.from_rig(rig, VALUES))
    save_model(folder / "model.toml", Model.from_rig(rig, VALUES, effects=effects))
    content = {
        "verdict": "missing" if effects else "sufficient",
        "effects": [{"name": one.name, "confusable_with": [], "parameters": {}} for one in effects],
        "parameters": {"gear_x": {"value": 0.06, "low": 0.05, "high": 0.07}},
    }
    files = {name: (folder / name).read_bytes() for name in ("base.toml", "model.toml")}
    return {
        **files,
        "diagnosis.json": json.dumps(content).encode(),
        "seconds.json": b'{"seconds":1.5}',
        "code.json": json.dumps({"code": PROVENANCE["code"]}).encode(),
    }


class Hat:
    """Workers that answer at once: that parallax is missing; `stop` after so many rigs."""

    def __init__(self, place: Path, stop: int | None = None) -> None:
        self.place, self.stop, self.asked = place, stop, list[str]()

    def each(self, module: str, inputs: Mapping[str, Files]) -> Iterator[tuple[str, Files]]:
        assert module == "irt.proof.blind"
        for name, files in inputs.items():
            if len(self.asked) == self.stop:
                raise KeyboardInterrupt
            self.asked.append(name)
            folder = self.place / f"{len(list(self.place.iterdir()))}"
            write_folder(folder, files)
            yield name, answered(folder, (PARALLAX,))


@pytest.fixture
def world() -> list[str]:
    """Return the command of the concealed world."""
    return WORLD


@pytest.fixture(name="answered")
def answer_of_parallax() -> Callable[[Path], dict[str, bytes]]:
    """Return what answers that parallax is missing."""
    return lambda folder: answered(folder, (PARALLAX,))


@pytest.fixture
def hat(tmp_path: Path) -> Callable[..., Hat]:
    """Return what makes workers that answer at once."""
    place = tmp_path / "hat"
    place.mkdir()
    return lambda stop=None: Hat(place, stop)


@pytest.fixture
def prove(tmp_path: Path, hat: Callable[..., Hat]) -> Callable[..., Places]:
    """Return what runs a proof of three rigs in a folder, with answers out of a hat."""

    def run(workers: Hat | None = None, **options: Any) -> Places:
        plan = options.pop("plan", Plan(none=1, single=2))
        options = {"seed": 5, "contest": False, **options}
        return Proof(
            tmp_path / "proof",
            plan,
            options.pop("world", WORLD),
            workers or hat(),
            options.pop("provenance", PROVENANCE),
            **options,
        ).run()

    return run


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a finished proof, to be copied before it is touched."""
    place = tmp_path_factory.mktemp("finished")
    (place / "hat").mkdir()
    plan = Plan(none=1, single=2)
    return (
        Proof(place / "proof", plan, WORLD, Hat(place / "hat"), PROVENANCE, seed=5, contest=False).run().out
    )


@pytest.fixture
def places(finished: Path, tmp_path: Path) -> Places:
    """Return a copy of a finished proof."""
    shutil.copytree(finished, tmp_path / "proof")
    return Places(tmp_path / "proof")


@pytest.fixture
def files() -> Callable[[Path], dict[str, bytes]]:
    """Return what reads all files below a folder."""
    return lambda folder: {
        str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


@pytest.fixture
def score(scores: Callable[[], Callable[..., RigScore]]) -> Callable[..., RigScore]:
    """Return what makes a score by hand."""
    return scores()


@pytest.fixture(scope="session")
def scores() -> Callable[[], Callable[..., RigScore]]:
    """Return what returns, each time, a maker of scores whose rigs are numbered from 1."""
    return _scores


def _scores() -> Callable[..., RigScore]:
    count = iter(range(1, 10_000))

    def make(group: str = "single", **values: Any) -> RigScore:
        kinds = {
            "single": ("delay",),
            "pair": ("delay", "bump"),
            "triple": ("delay", "bump", "lag"),
            "unlisted": ("unlisted_x",),
        }.get(group, ())
        given = {
            "rig": f"rig-{next(count):04d}",
            "kinds": kinds,
            "verdict": "missing" if kinds else "sufficient",
            "named": kinds,
            "exact": True,
            "found": True,
            "errors": Errors(base=0.02, final=0.0011, oracle=0.001, signal=8.0),
            "sigma": 1e-3,
            "seconds": 10.0,
        }
        return RigScore(group=group, **{**given, **values})

    return make
