"""The repository as a whole: what its pages promise is there, and its files work on any machine."""

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [page for folder in (".", "benches", "docs", "rig") for page in sorted(ROOT.glob(f"{folder}/*.md"))]
LONGEST_FILE = 500

# Written in parts, so that this file does not hold what it looks for.
REGISTRY_HOSTS = [
    ".".join(parts)
    for parts in (
        ("pypi", "org"),
        ("pythonhosted", "org"),
        ("static", "crates", "io"),
        ("index", "crates", "io"),
        ("registry", "npmjs", "org"),
        ("proxy", "golang", "org"),
        ("deb", "debian", "org"),
    )
]
MACHINE_PATH = re.compile(r"(?<![\w.$)}/])/(?:home|root|work|Users)/\w")


def tracked_files() -> list[Path]:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: which files belong to the repository is not known")
    listed = subprocess.check_output(["git", "ls-files", "-z"], cwd=ROOT, text=True)
    return [path for name in listed.split("\0") if name and (path := ROOT / name).is_file()]


def text_of(path: Path) -> str:
    """Return a file's text, or nothing for a binary file."""
    content = path.read_bytes()
    return "" if b"\0" in content else content.decode("utf-8")


def make_targets() -> set[str]:
    return set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def code_in(page: Path) -> str:
    """Return all that stands as code on a page, in blocks and within lines."""
    return "\n".join(re.findall(r"```.*?```|`[^`\n]+`", page.read_text(encoding="utf-8"), re.DOTALL))


def test_no_file_names_a_registry_or_a_path_of_one_machine() -> None:
    found = []
    for path in tracked_files():
        for number, line in enumerate(text_of(path).splitlines(), start=1):
            if MACHINE_PATH.search(line) or any(host in line for host in REGISTRY_HOSTS):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not found, "\n".join(found)


def test_no_source_file_holds_two_things() -> None:
    long = {
        str(path.relative_to(ROOT)): lines
        for path in tracked_files()
        if path.suffix in {".py", ".pyi", ".rs"} and (lines := len(text_of(path).splitlines())) > LONGEST_FILE
    }
    assert not long


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_make_commands_on_a_page_exist(page: Path) -> None:
    named = set(re.findall(r"\bmake ([a-z-]+)", code_in(page)))
    assert named <= make_targets()


def test_readme_opens_with_the_two_commands() -> None:
    commands = re.findall(r"^make ([a-z-]+)", code_in(ROOT / "README.md"), re.MULTILINE)
    assert commands[:2] == ["demo", "test"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_and_pictures_on_a_page_exist(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8"))
    missing = [
        target for target in targets if "://" not in target and not (page.parent / target.strip()).exists()
    ]
    assert not missing


def test_continuous_integration_runs_what_a_developer_runs() -> None:
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert {"docs", "lint", "test"} <= set(re.findall(r"\bmake ([a-z-]+)", script)) <= make_targets()
    assert ".ci/run" in (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")


def pins_of(lock: str) -> dict[str, set[str]]:
    """Return the lines of a lock by package; each must be a plain pin."""
    pins: dict[str, set[str]] = {}
    for line in (ROOT / lock).read_text(encoding="utf-8").splitlines():
        pin = re.fullmatch(r"([a-z0-9.-]+)==[\w.!+]+(?: ; .+)?", line)
        assert pin, line
        pins.setdefault(pin[1], set()).add(line)
    return pins


def test_locks_pin_every_requirement_and_nothing_else() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    base, *extras = (
        {re.split(r"[\[<>=~!; ]", requirement, maxsplit=1)[0] for requirement in group}
        for group in (project["dependencies"], *project["optional-dependencies"].values())
    )
    everything, lock = pins_of("requirements.lock"), pins_of("requirements-base.lock")
    assert base.union(*extras) <= everything.keys()
    assert base | {"maturin"} <= lock.keys()
    assert all(everything[name] == lines for name, lines in lock.items())
    assert not {"torch", "opencv-python-headless", "rosbags"} & lock.keys()


@pytest.mark.parametrize("folder", ["benches", "docs"])
def test_other_locks_pin_what_is_asked_for(folder: str) -> None:
    asked = (ROOT / folder / "requirements.in").read_text(encoding="utf-8").splitlines()
    names = {re.split(r"[\[<>=~!;# ]", line, maxsplit=1)[0] for line in asked} - {""}
    assert names <= pins_of(f"{folder}/requirements.txt").keys()


def test_one_version_everywhere() -> None:
    version = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["package"][
        "version"
    ]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    newest = re.search(r"^## \[(\d.*?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest is not None
    assert newest[1] == version
