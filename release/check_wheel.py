"""Build the wheel in two folders and check it: the same bits, no path of this machine, a true tag.

    make check-wheel

``CARGO_PROFILE_RELEASE_OPT_LEVEL=0 make check-wheel`` takes a quarter of the time, and checks all but the
optimiser. The sources are those of the last commit. The second build has another time zone, and other
permissions of new files.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from sbom import PRODUCTS, ROOT

BIN = Path(sys.executable).parent


def build(folder: Path, zone: str, mask: int) -> Path:
    """Return the wheel of the last commit, built in a folder."""
    subprocess.run(["git", "clone", "--quiet", ROOT, folder], check=True, umask=mask)
    # What an outer make or cargo has set does not hold here, but where cargo is, and how it compiles.
    kept = ("CARGO_HOME", "CARGO_PROFILE_", "RUSTUP_")
    dropped = ("CARGO_", "MAKE", "RUST")
    inherited = {
        key: value for key, value in os.environ.items() if key.startswith(kept) or not key.startswith(dropped)
    }
    subprocess.run(
        ["make", "wheel", f"BIN={BIN}", "BASE="],
        cwd=folder,
        env={**inherited, "TZ": zone},
        check=True,
        umask=mask,
    )
    (wheel,) = (folder / "dist").glob("*.whl")
    return wheel


def members(wheel: Path) -> dict[str, bytes]:
    """Return the files of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def differences(one: Path, other: Path) -> list[str]:
    """Return what two wheels differ in: files, or what an archive says of them."""
    if one.read_bytes() == other.read_bytes():
        return []
    first, second = members(one), members(other)
    names = sorted(first.keys() | second.keys())
    differ = [name for name in names if first.get(name) != second.get(name)]
    return differ or ["the same files, but other dates, permissions or order"]


def paths_in(wheel: Path, folders: list[Path]) -> list[str]:
    """Return the files of a wheel that name one of these folders."""
    words = [str(folder).encode() for folder in folders]
    return [name for name, data in members(wheel).items() if any(word in data for word in words)]


def audited_tag(wheel: Path) -> str:
    """Return the oldest platform on which a wheel runs, by the symbols and libraries that it needs."""
    said = subprocess.check_output([BIN / "auditwheel", "show", wheel], text=True)
    tag = re.search(r'following platform\s+tag:\s+"(\w+)"', said)
    assert tag, said
    return tag[1]


def mistakes(wheel: Path, folders: list[Path]) -> list[str]:
    """Return what is wrong with a wheel."""
    found = [f"{name} holds a path of this machine" for name in paths_in(wheel, folders)]
    bills = {name: data for name, data in members(wheel).items() if "/sboms/" in name}
    if list(bills.values()) != [PRODUCTS[0].path.read_bytes()]:
        found.append(
            f"the bills of materials are {list(bills)}: expected that of {PRODUCTS[0].crate}, as committed"
        )
    if sys.platform == "linux" and (tag := audited_tag(wheel)) not in wheel.stem.split("-")[-1].split("."):
        found.append(f"it is named {wheel.name}, and runs on {tag}")
    return found


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        first, second = Path(name) / "a", Path(name) / "other" / "folder"
        wheels = build(first, "UTC", 0o022), build(second, "Asia/Kathmandu", 0o077)
        homes = [Path.home(), Path(os.environ.get("CARGO_HOME", Path.home() / ".cargo"))]
        found = [f"{one} differs between two builds" for one in differences(*wheels)]
        found += mistakes(wheels[0], [first, second, *homes])
        for wheel in wheels:
            print(f"{hashlib.sha256(wheel.read_bytes()).hexdigest()}  {wheel.name}")
    print("\n".join(found) or "two builds gave the same bits")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
