"""The same answers from a Ray cluster as from this machine, bit for bit."""

from __future__ import annotations

import sys
import types
import warnings
from collections.abc import Iterator

import pytest

from irt.errors import IrtError
from irt.prove.cluster import RayWorkers
from irt.prove.workers import LocalWorkers, files_of

BLIND = "irt.prove.blind"


@pytest.fixture(scope="module")
def local_ray() -> Iterator[str]:
    """Start a Ray cluster of two cores on this machine, whatever other cluster it may belong to."""
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


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_same_answers_bit_for_bit(local_ray: str, places) -> None:
    inputs = {"rig-0001": files_of(places.rig("rig-0001"))}
    inputs["broken"] = {**inputs["rig-0001"], "train-1.csv": b"step\n"}
    told = {}
    for workers in (LocalWorkers(1), RayWorkers(local_ray)):
        answers = dict(workers.each(BLIND, inputs))
        for files in answers.values():
            files.pop("seconds.json", None)
        told[type(workers).__name__] = answers
    assert told["RayWorkers"] == told["LocalWorkers"]
    assert list(told["RayWorkers"]["broken"]) == ["failed.json"]


def test_without_ray_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(IrtError, match=r'needs the package ray: install it with: pip install "labsim-irt\['):
        RayWorkers("auto")


@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1", "127.0.0.1:99999"])
def test_where_no_cluster_is_it_says_so_at_once(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    asleep = types.SimpleNamespace(is_initialized=lambda: False)
    monkeypatch.setitem(sys.modules, "ray", asleep)
    with pytest.raises(IrtError, match=f"no Ray cluster answers at {address}: "):
        RayWorkers(address)
