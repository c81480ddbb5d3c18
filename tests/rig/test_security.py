"""With a keystore nobody takes part without a certificate; enforced without one, nothing starts."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest
from keystore import make
from secured import environment
from test_story import MODEL, laboratory

HERE = Path(__file__).resolve().parent
Inside = Callable[..., CompletedProcess[str]]


def refusal(rig: Path, folder: Path, **variables: str) -> str:
    """Return the one line with which a rig does not start."""
    shutil.copy(HERE.parents[1] / "rig" / "example" / "rig.toml", folder)
    ran = subprocess.run(
        [rig, "listen", "--seconds", "1"],
        cwd=folder,
        env={**environment(""), **variables},
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert ran.returncode == 1, ran
    assert not (folder / "bags").exists()
    (line,) = ran.stderr.splitlines()
    return line


@pytest.fixture(scope="module")
def built_in(rig: Path) -> bool:
    """Return whether the rig is built with DDS Security."""
    bill = json.loads(subprocess.check_output([rig, "sbom"], text=True))
    return "openssl" in {one["name"] for one in bill["components"]}


def test_a_rig_that_must_be_secured_and_cannot_be_does_not_start(
    rig: Path, tmp_path: Path, built_in: bool
) -> None:
    enforced = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}
    store = {"ROS_SECURITY_KEYSTORE": str(tmp_path / "none")}
    said = refusal(rig, tmp_path, **enforced, **store)
    assert said.startswith("rig: ROS_SECURITY_STRATEGY is Enforce, and peers cannot be authenticated: ")
    assert said.endswith(
        f"{tmp_path}/none/enclaves/rig/identity_ca.cert.pem: is missing"
        if built_in
        else "this program is built without DDS Security (cargo build --features security)"
    )
    assert "expected true or false" in refusal(rig, tmp_path, ROS_SECURITY_ENABLE="yes")


class Secured:
    """A rig with DDS Security, its twin, and an intruder."""

    def __init__(self, rig: Path, inside: Inside, folder: Path) -> None:
        self.rig, self.inside, self.folder = rig, inside, folder
        self.keystore = make(folder / "keystore", "rig", "rig_twin")

    def play(self, name: str, keystore: Path | None, twins: Path | None, *, intrude: bool) -> dict[str, Any]:
        folder = laboratory(self.folder / name, 1, 5.0, model=MODEL)
        words = (folder, self.rig, keystore or "", twins or "", "yes" if intrude else "")
        ran = self.inside(sys.executable, HERE / "secured.py", *words, timeout=200.0)
        assert ran.returncode == 0, ran.stderr
        found: dict[str, Any] = json.loads(ran.stdout.strip().splitlines()[-1])
        return found


@pytest.fixture
def secured(rig: Path, inside: Inside, tmp_path: Path, built_in: bool) -> Secured:
    """Skip without a rig that has DDS Security, or without OpenSSL."""
    if not built_in:
        pytest.skip("the rig is built without DDS Security: 'make test-security' builds and tries it")
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    return Secured(rig, inside, tmp_path)


def codes(found: dict[str, Any]) -> list[str]:
    return [code for code, _ in found["events"]]


@pytest.mark.slow
@pytest.mark.usefixtures("cyclone")
def test_an_intruder_without_a_certificate_does_nothing_and_is_recorded(secured: Secured) -> None:
    found = secured.play("lab", secured.keystore, secured.keystore, intrude=True)
    assert found["status"] == 0, found
    assert found["out"].startswith("peers are authenticated by ")
    assert (found["matched"], found["foreign"], found["pressed"]) == (0, 0, 0), found
    assert codes(found)[0] == "authenticated"
    assert codes(found)[-1] == "end"
    assert "refused_peer" in codes(found)
    assert not [code for code in codes(found) if code.startswith("stopping")]
    # Nobody is refused where nobody intrudes.
    assert "refused_peer" not in codes(
        secured.play("alone", secured.keystore, secured.keystore, intrude=False)
    )


@pytest.mark.slow
@pytest.mark.usefixtures("cyclone")
def test_the_same_intruder_stops_a_rig_without_a_keystore(secured: Secured) -> None:
    found = secured.play("lab", None, None, intrude=True)
    assert found["status"] == 1, found
    assert found["out"].startswith("no peer is authenticated: ")
    assert found["matched"] > 0
    assert codes(found)[0] == "unauthenticated"
    assert "played" not in codes(found)


@pytest.mark.slow
def test_a_twin_of_another_authority_is_refused_and_recorded(secured: Secured) -> None:
    other = make(secured.folder / "other", "rig", "rig_twin")
    found = secured.play("lab", secured.keystore, other, intrude=False)
    assert found["status"] == 1, found
    assert "nobody publishes there" in found["err"]
    refusals = [why for code, why in found["events"] if code == "refused_peer"]
    assert any("Certificate" in why for why in refusals), found["events"]
    assert "armed" not in codes(found)


@pytest.mark.slow
def test_a_forged_permission_is_refused(secured: Secured) -> None:
    permissions = secured.keystore / "enclaves" / "rig" / "permissions.p7s"
    text = permissions.read_text(encoding="utf-8")
    assert text.count("2120-01-01") == 1
    permissions.write_text(text.replace("2120-01-01", "2121-01-01"), encoding="utf-8")
    folder = laboratory(secured.folder / "lab", 1, 5.0)
    variables = environment(str(secured.keystore))
    words = [f"{key}={value}" for key, value in variables.items() if key.startswith("ROS_SECURITY")]
    ran = secured.inside("env", *words, secured.rig, "check", cwd=folder)
    assert ran.returncode == 1, ran
    (line,) = ran.stderr.splitlines()
    assert "security" in line.lower(), line
