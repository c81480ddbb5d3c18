"""What is built in: known sources, permissive licences, few duplicates, and no unsafe code."""

import importlib.metadata
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

#: Licences under which anything may be built in.
PERMISSIVE = {
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "MIT",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
}

#: Crates of which a binary holds several versions, because its crates ask for them.
DUPLICATES = {"cfg-if", "glam", "hashbrown", "itertools", "mio", "syn", "thiserror", "thiserror-impl"}

#: What distributions of the base say of their licence, in their own words.
WORDS = re.compile(r"\b(MIT|BSD|Apache|PSF|Python Software Foundation|Matplotlib|HPND|MIT-CMU|MPL-2\.0)\b")


def is_permitted(expression: str) -> bool:
    """Whether an SPDX expression can be met by permissive licences alone."""
    expression = expression.replace("/", " OR ")
    while (inner := re.search(r"\(([^()]*)\)", expression)) is not None:
        verdict = "MIT" if is_permitted(inner[1]) else "none"
        expression = expression.replace(inner[0], verdict)
    alternatives = re.split(r"\s+OR\s+", expression)
    return any(all(one.strip() in PERMISSIVE for one in re.split(r"\s+AND\s+", way)) for way in alternatives)


@pytest.mark.parametrize(
    ("expression", "permitted"),
    [
        ("MIT", True),
        ("GPL-3.0-only", False),
        ("GPL-3.0-only OR MIT", True),
        ("MIT AND GPL-3.0-only", False),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", True),
        ("(MIT OR GPL-3.0-only) AND LGPL-3.0-only", False),
        ("Unlicense/MIT", True),
    ],
)
def test_expressions_are_understood(expression, permitted):
    assert is_permitted(expression) == permitted


@pytest.fixture(scope="module")
def packages():
    if shutil.which("cargo") is None:
        pytest.skip("cargo is not installed")
    words = (
        "--locked",
        "--offline",
        "--format-version",
        "1",
        "--filter-platform",
        "x86_64-unknown-linux-gnu",
    )
    done = subprocess.run(
        ["cargo", "metadata", *words], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    if "--offline" in done.stderr:
        pytest.skip("the crates are not on this machine yet: 'cargo fetch' brings them")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["packages"]


def test_crates_have_permissive_licences(packages):
    refused = {one["name"]: one["license"] for one in packages if not is_permitted(one["license"] or "none")}
    assert not refused


def test_crates_are_few_times_there(packages):
    names = [one["name"] for one in packages]
    assert {name for name in names if names.count(name) > 1} <= DUPLICATES


def test_crates_come_from_the_registry_with_a_checksum():
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    own = {one["name"] for one in locked if "source" not in one}
    assert own == {"labsim", "labsim-py", "rig"}
    foreign = [one for one in locked if one["name"] not in own]
    assert all(one["source"].startswith("registry+") and one["checksum"] for one in foreign)


def test_unsafe_code_is_forbidden_in_every_crate():
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]
    assert workspace["lints"]["rust"]["unsafe_code"] == "forbid"
    for member in workspace["members"]:
        assert tomllib.loads((ROOT / member / "Cargo.toml").read_text())["lints"] == {"workspace": True}


def test_packages_of_the_base_have_permissive_licences():
    pinned = re.findall(r"^([\w.-]+)==", (ROOT / "requirements-base.lock").read_text(), re.MULTILINE)
    refused = {}
    for name in pinned:
        try:
            about = importlib.metadata.metadata(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # of another system
        classifiers = [one for one in about.get_all("Classifier", []) if one.startswith("License ::")]
        said = about.get("License-Expression") or " ".join(classifiers) or about.get("License") or "nothing"
        if not WORDS.search(said) or re.search(r"\bA?GPL", said):
            refused[name] = said[:80]
    assert not refused
