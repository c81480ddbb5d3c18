"""The set-up of a fresh machine: which Python becomes .venv, and the one line that says what is missing."""

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
        for name in ("Makefile", "requirements.lock", "requirements-base.lock"):
            shutil.copy(ROOT / name, self.checkout)
        for name in ("find", "mkdir", "rm", "sh", "touch"):
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


@pytest.mark.parametrize(
    ("target", "lock"), [(".base", "requirements-base.lock"), (".packages", "requirements.lock")]
)
def test_each_set_of_packages_has_its_lock(machine: FreshMachine, target: str, lock: str) -> None:
    machine.add_python("python3")
    machine.make(".venv/bin/python")
    log, python = machine.checkout / "log", machine.checkout / ".venv/bin/python"
    python.write_text(f'#!/bin/sh\necho "$@" >> {log}\n')
    python.chmod(0o755)

    assert machine.make(f".venv/{target}").returncode == 0
    assert log.read_text().endswith(f" --requirement {lock}\n")


@pytest.mark.parametrize("built", [False, True])
def test_a_first_demo_leaves_no_intermediate_files(machine: FreshMachine, built: bool) -> None:
    """Where there are some already, somebody builds: these stay."""
    venv = machine.checkout / ".venv" / "bin"
    venv.mkdir(parents=True)
    for name, script in {"python": "exit 0", "maturin": "mkdir -p target", "irt": 'echo "$@"'}.items():
        machine.add(name, script)
        shutil.copy(machine.tools / name, venv / name)
    for name in ("Cargo.toml", "pyproject.toml"):
        (machine.checkout / name).touch()
    if built:
        (machine.checkout / "target").mkdir()

    ran = machine.make("demo")

    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.splitlines()[-1] == "demo"
    assert (machine.checkout / "target").exists() == built


@pytest.fixture
def debian(machine: FreshMachine) -> FreshMachine:
    """A machine where root installs by apt-get, which keeps a log of its arguments."""
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
