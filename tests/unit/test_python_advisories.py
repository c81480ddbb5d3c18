"""Pinned versions in a database of vulnerabilities are found, and no others."""

from pathlib import Path

import pytest

pytest.importorskip("yaml", reason="pyyaml is not installed (extra 'dev')")

from python_advisories import found, pinned

ADVISORY = """
id: PYSEC-1-1
aliases: [CVE-1-1]
affected:
- package: {name: Some_Package, ecosystem: PyPI}
  ranges:
  - type: GIT
    events: [{introduced: "0"}]
  - type: ECOSYSTEM
    events: [{introduced: "1.2"}, {fixed: "1.10"}, {introduced: "2.0"}, {last_affected: "2.3"}]
  versions: ["0.7rc1"]
"""


@pytest.fixture
def database(tmp_path: Path) -> Path:
    folder = tmp_path / "vulns" / "some-package"
    folder.mkdir(parents=True)
    (folder / "PYSEC-1-1.yaml").write_text(ADVISORY)
    (folder / "PYSEC-1-2.yaml").write_text(
        ADVISORY.replace("1-1", "1-2") + "withdrawn: 2020-01-01T00:00:00Z\n"
    )
    return tmp_path


@pytest.mark.parametrize(
    ("version", "vulnerable"),
    [
        ("0.7rc1", True),
        ("0.7", False),
        ("1.1.9", False),
        ("1.2", True),
        ("1.9.1", True),
        ("1.10", False),
        ("2.0", True),
        ("2.3", True),
        ("2.3.1", False),
    ],
)
def test_a_version_is_found_where_it_is_affected(database: Path, version: str, vulnerable: bool) -> None:
    packages = pinned([f"other==1.2\nSome.Package=={version} ; python_full_version < '3.14'\n"])
    assert len(packages) == 2
    lines = list(found(database, packages))
    assert lines == ([f"some-package {version}: PYSEC-1-1 CVE-1-1"] if vulnerable else [])
