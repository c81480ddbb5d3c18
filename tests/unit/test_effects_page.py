"""docs/effects.md says what the engine's catalogue says."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from irt.catalogue import effects

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("effects_page", DOCS / "effects.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_page_is_what_the_catalogue_says(script: ModuleType) -> None:
    written = (DOCS / "effects.md").read_text(encoding="utf-8")
    drawn_at = dict(re.findall(r"^## (\w+)$.*?^Drawn at (.*?)\.$", written, re.MULTILINE | re.DOTALL))
    assert script.page(drawn_at) == written, "the catalogue has changed: run `make pictures`"


def test_every_effect_has_its_picture() -> None:
    assert {path.stem for path in (DOCS / "effects").glob("*.svg")} == {effect.name for effect in effects()}


@pytest.mark.parametrize("effect", effects(), ids=lambda effect: effect.name)
def test_examples_show_within_the_range(script: ModuleType, effect) -> None:
    values, base, changed = script.example(effect)
    assert abs(changed - base).max() > 0.002
    for parameter in effect.required:
        inside = parameter.low <= values[parameter.name] <= parameter.high
        assert inside or values[parameter.name] == parameter.neutral
