"""Write the bills of materials of the wheel and of `rig`: which crates are built in, and which build them.

    python release/sbom.py

They are CycloneDX 1.5, without a date or a serial number: the same Cargo.lock gives the same files. A crate
of scope ``excluded`` takes part in the build alone: it runs in a build script or expands macros.
"""

from __future__ import annotations

import json
import re
import subprocess
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
_SCHEMA = "http://cyclonedx.org/schema/bom-1.5.schema.json"
_LINE = re.compile(
    r"(?P<depth>\d+) (?P<name>\S+) v(?P<version>\S+)"
    r"(?P<macro> \(proc-macro\))?(?: \(/.*\))?\|(?P<license>[^|]+)\|"
)


@dataclass(frozen=True)
class Product:
    """What is built of a crate, and where its bill of materials lies beside it."""

    crate: str
    kind: str
    path: Path
    features: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return self.path.name.removesuffix(".cdx.json")


PRODUCTS = (
    Product("labsim-py", "library", ROOT / "crates" / "labsim-py" / "labsim-py.cdx.json"),
    Product("rig", "application", ROOT / "rig" / "rig.cdx.json"),
    Product("rig", "application", ROOT / "rig" / "rig-security.cdx.json", ("security",)),
)


@dataclass(frozen=True, order=True)
class Crate:
    """A crate in one version."""

    name: str
    version: str
    license: str = field(compare=False)
    is_macro: bool = field(compare=False)

    @property
    def purl(self) -> str:
        return f"pkg:cargo/{self.name}@{self.version}"


Graph = dict[Crate, set[Crate]]


def graph(product: Product, edges: str, targets: Iterable[str]) -> tuple[Crate, Graph]:
    """Return the crate of a product and its dependencies of some kinds, on all of these systems."""
    found: Graph = {}
    root = None
    for target in targets:
        words = ("--locked", "--offline", "--package", product.crate, "--edges", edges, "--target", target)
        features = ("--features", ",".join(product.features)) if product.features else ()
        # The bars separate what may hold blanks; a crate that was shown before has a star behind them.
        shown = subprocess.check_output(
            ["cargo", "tree", *words, *features, "--prefix", "depth", "--format", " {p}|{l}|"],
            cwd=ROOT,
            text=True,
        )
        above: list[Crate] = []
        for line in shown.splitlines():
            parts = _LINE.match(line)
            assert parts, line
            terms = parts["license"].replace("/", " OR ")
            one = Crate(parts["name"], parts["version"], terms, bool(parts["macro"]))
            del above[int(parts["depth"]) :]
            found.setdefault(one, set())
            if above:
                found[above[-1]].add(one)
            above.append(one)
        root = above[0]
    assert root is not None, "no system is named"
    return root, found


def built_in(root: Crate, normal: Graph) -> set[Crate]:
    """Return the crates whose code is in what is built of a crate: macros and what they need are not."""
    found, waiting = {root}, [root]
    while waiting:
        further = {one for one in normal[waiting.pop()] if not one.is_macro} - found
        found |= further
        waiting += further
    return found


def bill(product: Product) -> dict[str, Any]:
    """Return the bill of materials of a product."""
    policy = tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8"))
    targets = policy["graph"]["targets"]
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text(encoding="utf-8"))["package"]
    checksums = {(one["name"], one["version"]): one.get("checksum") for one in locked}
    root, everything = graph(product, "normal,build", targets)
    inside = built_in(root, graph(product, "normal", targets)[1])

    def component(one: Crate) -> dict[str, Any]:
        said: dict[str, Any] = {
            "type": product.kind if one == root else "library",
            "bom-ref": one.purl,
            "name": one.name,
            "version": one.version,
            "scope": "required" if one in inside else "excluded",
            "licenses": [{"expression": one.license}],
            "purl": one.purl,
        }
        checksum = checksums[one.name, one.version]
        return said | ({"hashes": [{"alg": "SHA-256", "content": checksum}]} if checksum else {})

    return {
        "$schema": _SCHEMA,
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": component(root)},
        "components": [component(one) for one in sorted(everything) if one != root],
        "dependencies": [
            {"ref": one.purl, "dependsOn": sorted(other.purl for other in everything[one])}
            for one in sorted(everything)
        ],
    }


def text(product: Product) -> str:
    """Return the file of a bill of materials, with a line for each crate."""
    found = bill(product)
    lists = {key: found.pop(key) for key in ("components", "dependencies")}
    head = json.dumps(found, indent=1).removesuffix("\n}")
    rest = (
        f' "{key}": [\n  ' + ",\n  ".join(map(json.dumps, entries)) + "\n ]" for key, entries in lists.items()
    )
    return ",\n".join([head, *rest]) + "\n}\n"


def main() -> None:
    for product in PRODUCTS:
        product.path.write_text(text(product), encoding="utf-8")


if __name__ == "__main__":
    main()
