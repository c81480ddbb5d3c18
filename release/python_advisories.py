"""Look known vulnerabilities of the pinned Python packages up in PyPA's advisory database.

    python release/python_advisories.py [--database FOLDER]

Without a folder the database is fetched from the network. Exit status 1 if a pinned version is vulnerable.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped]  # it has no types
from packaging.utils import canonicalize_name
from packaging.version import Version

from sbom import ROOT

DATABASE = "https://github.com/pypa/advisory-database"
LOCKS = ("requirements.lock", "requirements-base.lock", "docs/requirements.txt", "benches/requirements.txt")
_PIN = re.compile(r"^([\w.-]+)==([\w.+!-]+)", re.MULTILINE)


def pinned(texts: list[str]) -> set[tuple[str, str]]:
    """Return names and versions of the packages that locks pin."""
    return {(canonicalize_name(name), version) for text in texts for name, version in _PIN.findall(text)}


def affects(version: str, affected: dict[str, Any]) -> bool:
    """Return whether an entry of an advisory names a version, or has it in one of its ranges."""
    if version in affected.get("versions", []):
        return True
    this = Version(version)
    for one in affected.get("ranges", []):
        if one["type"] != "ECOSYSTEM":
            continue
        inside = False
        for event in one["events"]:
            if "introduced" in event and (event["introduced"] == "0" or this >= Version(event["introduced"])):
                inside = True
            if "fixed" in event and this >= Version(event["fixed"]):
                inside = False
            if "last_affected" in event and this > Version(event["last_affected"]):
                inside = False
        if inside:
            return True
    return False


def found(database: Path, packages: set[tuple[str, str]]) -> Iterator[str]:
    """Yield a line for each advisory of a pinned version."""
    for path in sorted((database / "vulns").rglob("*.yaml")):
        versions = [version for name, version in packages if name == canonicalize_name(path.parent.name)]
        if not versions:
            continue
        advisory = yaml.safe_load(path.read_text(encoding="utf-8"))
        if "withdrawn" in advisory:
            continue
        for version in versions:
            if any(affects(version, one) for one in advisory["affected"]):
                names = " ".join([advisory["id"], *advisory.get("aliases", [])])
                yield f"{path.parent.name} {version}: {names}"


def main() -> int:
    """Print what is found, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--database", type=Path, help="a copy of it (default: from the network)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        database = args.database or Path(name) / "database"
        if args.database is None:
            subprocess.run(["git", "clone", "--quiet", "--depth", "1", DATABASE, database], check=True)
        if not (database / "vulns").is_dir():
            parser.error(f"{database}: has no folder vulns")
        packages = pinned([(ROOT / lock).read_text(encoding="utf-8") for lock in LOCKS])
        lines = list(found(database, packages))
    print("\n".join(lines) or f"{len(packages)} pinned versions, none of them in the database")
    return bool(lines)


if __name__ == "__main__":
    sys.exit(main())
