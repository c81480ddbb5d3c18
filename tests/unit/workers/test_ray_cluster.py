"""The same answers from a Ray cluster as from this machine, bit for bit."""

from __future__ import annotations

import sys
import types
import warnings
from collections.abc import Iterator
from importlib.machinery import ModuleSpec

import numpy as np
import pytest

from irt.engine import paper_drive, rollouts
from irt.errors import IrtError
from irt.tuning.drive import Drive
from irt.tuning.pairs import simulate_pairs
from irt.workers.choice import make_workers
from irt.workers.cluster import RayWorkers
from irt.workers.processes import LocalWorkers, files_of

TRUTH = [[0.06, 0.05, 4e-4, 15.0, 1.03]]


@pytest.fixture(scope="module")
def local_ray() -> Iterator[str]:
    """Start a Ray cluster of two cores on this machine, independent of any other cluster."""
    ray = pytest.importorskip("ray", reason="ray is an optional package: labsim-irt[cluster]")
    with warnings.catch_warnings():
        # Ray's own: how it starts and ends processes.
        warnings.simplefilter("ignore")
        try:
            ray.init(
                "local",
                num_cpus=2,
                include_dashboard=False,
                logging_level="error",
                log_to_driver=False,
                _node_ip_address="127.0.0.1",
            )
        except (ConnectionError, OSError, RuntimeError, ValueError) as error:
            pytest.skip(f"Ray does not start on this machine: {error}")
        yield "auto"
        ray.shutdown()


@pytest.fixture
def rigs(write_rig):
    """Return two small rigs, the second of which is broken."""
    random = np.random.default_rng(3)
    knobs = paper_drive(steps=40)
    runs = {
        f"run-{index}": (knobs, marble + 1e-3 * random.standard_normal(marble.shape))
        for index in range(2)
        for marble in rollouts(TRUTH, (-1) ** index * knobs)
    }
    whole, broken = write_rig(runs, folder="whole"), write_rig(runs, folder="broken")
    (broken / "run-1.csv").write_text("step\n")
    return whole, broken


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("module", ["irt.proof.blind", "irt.report.diagnosed"])
def test_a_cluster_diagnoses_the_same_bit_for_bit(local_ray: str, rigs, module: str) -> None:
    inputs = {path.name: files_of(path) for path in rigs}
    if module == "irt.report.diagnosed":
        inputs = {
            name: {"path": name.encode(), **{f"rig/{file}": data for file, data in files.items()}}
            for name, files in inputs.items()
        }
    results = {}
    for workers in (LocalWorkers(2), RayWorkers(local_ray)):
        answers = dict(workers.each(module, inputs, ["7"] if "report" in module else []))
        # These files contain wall times, which differ.
        for files in answers.values():
            for name in ("seconds.json", "diagnosis.json", "report.html"):
                files.pop(name, None)
        results[type(workers).__name__] = answers
    assert results["RayWorkers"] == results["LocalWorkers"]
    assert list(results["RayWorkers"]["broken"]) == ["failed.json"]
    assert "model.toml" in results["RayWorkers"]["whole"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_simulates_the_same_pairs_bit_for_bit(local_ray: str, monkeypatch) -> None:
    monkeypatch.setattr("irt.tuning.pairs._ROWS_AT_ONCE", 4_000)
    drive = Drive.paper()
    here = simulate_pairs(drive, 50, seed=1)
    assert simulate_pairs(drive, 50, seed=1, workers=make_workers(cluster=local_ray)).digest == here.digest


def test_without_ray_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(IrtError, match=r"^--cluster needs Ray: pip install 'labsim-irt\[cluster\]'$"):
        make_workers(cluster="auto")


@pytest.mark.slow
@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1", "127.0.0.1:99999"])
def test_where_no_cluster_is_it_says_so_at_once(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    asleep = types.SimpleNamespace(is_initialized=lambda: False, __spec__=ModuleSpec("ray", None))
    monkeypatch.setitem(sys.modules, "ray", asleep)
    with pytest.raises(IrtError, match=f"no Ray cluster answers at {address}: "):
        RayWorkers(address)
