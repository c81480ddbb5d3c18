"""The oldest packages that are tested: each lower bound of the base, on tests that are there."""

import re
import tomllib

import pytest

import oldest
from sbom import ROOT


def test_each_lower_bound_becomes_the_only_version() -> None:
    assert oldest.oldest(["numpy>=2.1", "scipy >= 1.15, <2"]) == ["numpy==2.1", "scipy ==1.15"]
    with pytest.raises(AssertionError, match="no lower bound"):
        oldest.oldest(["numpy"])


def test_every_package_of_the_base_has_a_lower_bound() -> None:
    base = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    pinned = oldest.oldest(base)
    assert len(pinned) == len(base)
    assert all(re.fullmatch(r"[a-z0-9-]+==[\d.]+", one) for one in pinned)


def test_the_tests_are_there() -> None:
    assert all((ROOT / name).exists() for name in oldest.TESTS)
