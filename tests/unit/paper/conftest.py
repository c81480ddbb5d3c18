"""What the tests of the reproduction share: few trials, and networks that have hardly learned."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from irt.paper import networks, standin
from irt.paper.setting import Setting


@pytest.fixture(scope="package")
def _quick() -> pytest.MonkeyPatch:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(networks, "PAPERS_WAY", {**networks.PAPERS_WAY, "pairs": 300, "epochs": 20})
        patch.setattr(
            standin, "LABORATORY", (sys.executable, f"{Path(__file__).with_name('fake_laboratory.py')}")
        )
        yield patch


@pytest.fixture(scope="package")
def setting(_quick: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Setting:
    """Return a setting of a few trials."""
    return Setting(tmp_path_factory.mktemp("reproduced"), targets=6, rigs=3, diagnosed=0, threads=1)
