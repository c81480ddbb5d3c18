from __future__ import annotations

import subprocess
import sys
import types

import pytest

import irt


def run(script: str) -> str:
    """Run a script in a fresh interpreter and return what it prints."""
    return subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout.strip()


def test_every_public_name_is_there() -> None:
    for name in irt.__all__:
        assert getattr(irt, name) is not None
        assert not isinstance(getattr(irt, name), types.ModuleType)
    assert set(irt.__all__) <= set(dir(irt))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'irt' has no attribute 'nonsense'"):
        _ = irt.nonsense


def test_importing_loads_nothing_heavy() -> None:
    assert run("import sys, irt; print('numpy' in sys.modules)") == "False"


@pytest.mark.parametrize(
    "first", ["", "import irt.engine", "from irt.engine import paper_drive", "import irt.residual"]
)
def test_rollouts_is_the_function_after_any_import(first: str) -> None:
    assert run(
        f"{first}\nimport irt\nfrom irt import rollouts\nprint(callable(irt.rollouts), callable(rollouts))"
    ) == ("True True")


def test_the_version_is_the_engine_s() -> None:
    from irt import _labsim  # noqa: PLC0415

    assert irt.__version__ == _labsim.__version__
