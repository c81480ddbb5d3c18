"""The set-up of a fresh machine: which Python becomes .venv, and the one line that says what is missing."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MAKE = shutil.which("make")

pytestmark = pytest.mark.skipif(MAKE is None, reason="make is not installed")


class FreshMachine:
    """A copy of the Makefile on a machine that has nothing but the named fake tools and a shell."""

    def __init__(self, folder: Path) -> None:
        self.checkout = folder / "checkout"
        self.tools = folder / "tools"
        (self.checkout / "crates/labsim/src").mkdir(parents=True)
        self.tools.mkdir()
        for name in ("Makefile", "requirements.lock"):
            shutil.copy(ROOT / name, self.checkout)
        for name in ("find", "mkdir", "sh", "touch"):
            (self.tools / name).symlink_to(str(shutil.which(name)))
        self.add("cargo", "exit 0")
        self.add("cc", "exit 0")

    def add(self, name: str, script: str) -> None:
        tool = self.tools / name
        tool.write_text(f"#!/bin/sh\n{script}\n")
        tool.chmod(0o755)

    def add_python(self, name: str) -> None:
        """Add a Python whose only skill is to make a .venv, which says of itself where it came from."""
        self.add(name, f'[ "$1" = -c ] && exit 0; mkdir -p .venv/bin; echo {name} > .venv/bin/python')

    def make(self, target: str) -> subprocess.CompletedProcess[str]:
        environment = {"PATH": str(self.tools), "HOME": str(self.checkout)}
        command = [str(MAKE), "--no-print-directory", target]
        return subprocess.run(
            command, cwd=self.checkout, env=environment, capture_output=True, text=True, check=False
        )


@pytest.fixture
def machine(tmp_path: Path) -> FreshMachine:
    return FreshMachine(tmp_path)


def test_the_first_python_that_runs_is_taken(machine: FreshMachine) -> None:
    machine.add("python3.13", "echo 'version not installed' >&2; exit 127")
    machine.add_python("python3.12")
    machine.add_python("python3")

    assert machine.make(".venv/bin/python").returncode == 0
    assert (machine.checkout / ".venv/bin/python").read_text() == "python3.12\n"


@pytest.mark.parametrize("target", ["demo", "test"])
def test_without_a_recent_python_one_line_says_so(machine: FreshMachine, target: str) -> None:
    machine.add("python3", "exit 1")

    ran = machine.make(target)

    said = [line for line in ran.stderr.splitlines() if not line.startswith("make: ***")]
    assert ran.returncode != 0
    assert len(said) == 1
    assert "Python 3.11 or newer" in said[0]
    assert not (machine.checkout / ".venv").exists()


@pytest.mark.parametrize(("tool", "name"), [("cargo", "cargo"), ("cc", "the C compiler cc")])
def test_a_missing_compiler_is_named_before_anything_is_installed(
    machine: FreshMachine, tool: str, name: str
) -> None:
    machine.add_python("python3")
    (machine.tools / tool).unlink()

    ran = machine.make("test")

    assert ran.returncode != 0
    assert ran.stderr.startswith(f"make: {name} is missing: install")
    assert not (machine.checkout / ".venv").exists()


def test_packages_are_installed_once_and_again_when_the_lock_changes(machine: FreshMachine) -> None:
    machine.add_python("python3")
    machine.make(".venv/bin/python")
    log = machine.checkout / "log"
    python = machine.checkout / ".venv/bin/python"
    python.write_text(f'#!/bin/sh\necho "$@" >> {log}\n')
    python.chmod(0o755)
    stamp = machine.checkout / ".venv/.packages"

    assert machine.make(str(stamp.relative_to(machine.checkout))).returncode == 0
    assert machine.make(str(stamp.relative_to(machine.checkout))).returncode == 0
    assert log.read_text().count("pip install") == 1

    newer = stamp.stat().st_mtime + 1
    os.utime(machine.checkout / "requirements.lock", (newer, newer))
    assert machine.make(str(stamp.relative_to(machine.checkout))).returncode == 0
    assert log.read_text().count("pip install") == 2


@pytest.fixture
def debian(machine: FreshMachine) -> FreshMachine:
    """A machine where root installs by apt-get, which keeps a log of what it was told."""
    machine.add("id", "echo 0")
    machine.add("env", 'shift; exec "$@"')
    machine.add("apt-get", 'echo "$@" >> apt.log')
    return machine


def test_a_browser_that_is_there_is_enough(debian: FreshMachine) -> None:
    debian.add("google-chrome", "exit 0")

    ran = debian.make("browser")

    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
    assert not (debian.checkout / "apt.log").exists()


def test_a_missing_browser_is_installed_by_root(debian: FreshMachine) -> None:
    ran = debian.make("browser")

    assert ran.returncode == 0
    assert ran.stderr == ""
    assert (debian.checkout / "apt.log").read_text() == "install --yes --no-install-recommends chromium\n"


def test_a_machine_that_knows_no_packages_yet_reads_their_list_first(debian: FreshMachine) -> None:
    debian.add("apt-get", 'echo "$1" >> apt.log; [ "$1" = update ] && echo > lists; [ -e lists ]')

    ran = debian.make("browser")

    assert (ran.returncode, ran.stderr) == (0, "")
    assert (debian.checkout / "apt.log").read_text().split() == ["install", "update", "install"]


def test_others_install_it_where_sudo_asks_for_no_password(debian: FreshMachine) -> None:
    debian.add("id", "echo 1000")
    debian.add("sudo", 'echo sudo >> apt.log; shift; [ "$1" = true ] || exec "$@"')

    assert debian.make("browser").returncode == 0
    assert (
        (debian.checkout / "apt.log")
        .read_text()
        .endswith("sudo\ninstall --yes --no-install-recommends chromium\n")
    )


@pytest.mark.parametrize(
    ("tool", "script", "says"),
    [
        ("apt-get", None, "none of chromium chromium-browser google-chrome is installed"),
        ("apt-get", "exit 100", "chromium could not be installed"),
        ("id", "echo 1000", "chromium is missing, 'sudo apt-get install chromium' adds it"),
    ],
)
def test_where_no_browser_can_be_had_one_line_says_what_is_skipped(
    debian: FreshMachine, tool: str, script: str | None, says: str
) -> None:
    if script is None:
        (debian.tools / tool).unlink()
    else:
        debian.add(tool, script)

    ran = debian.make("browser")

    assert ran.returncode == 0
    (line,) = ran.stderr.splitlines()
    assert says in line
    assert line.endswith("the tests that render a report in a browser are skipped")
