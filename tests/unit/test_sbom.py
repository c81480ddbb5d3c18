"""The bills of materials: up to date, whole, and sound; and what a check of wheels finds in them."""

import json
import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

import check_wheel
import irt._labsim
import sbom
from sbom import PRODUCTS, ROOT, Crate, Product, built_in

#: A panic names its file, and files of crates lie in a folder with their name and version.
_PLACE = re.compile(rb"/registry/src/[^/]+/([a-zA-Z0-9_-]+?)-(\d+\.\d+\.\d+[a-z0-9.+-]*)/")
products = pytest.mark.parametrize("product", PRODUCTS, ids=lambda product: product.name)


@pytest.mark.slow
@products
def test_bills_are_those_of_the_lock(product: Product) -> None:
    if shutil.which("cargo") is None:
        pytest.skip("cargo is not installed")
    try:
        expected = sbom.text(product)
    except subprocess.CalledProcessError:
        pytest.skip("the crates are not on this machine yet: 'cargo fetch' brings them")
    assert product.path.read_text(encoding="utf-8") == expected, "'make sbom' writes them anew"


@products
def test_bills_are_sound(product: Product) -> None:
    bill = json.loads(product.path.read_text(encoding="utf-8"))
    assert (bill["bomFormat"], bill["specVersion"], bill["version"]) == ("CycloneDX", "1.5", 1)
    main, *others = [bill["metadata"]["component"], *bill["components"]]
    assert (main["name"], main["type"]) == (product.crate, product.kind)
    refs = [one["bom-ref"] for one in (main, *others)]
    assert len(set(refs)) == len(refs)
    assert all(one["purl"] == f"pkg:cargo/{one['name']}@{one['version']}" for one in (main, *others))
    ours = {"labsim", "labsim-py", "rig"}
    for one in others:
        hashes = [re.fullmatch(r"[0-9a-f]{64}", said["content"]) for said in one.get("hashes", [])]
        assert hashes == [] if one["name"] in ours else all(hashes)
        assert bool(hashes) != (one["name"] in ours)
    edges = {one["ref"]: one["dependsOn"] for one in bill["dependencies"]}
    assert edges.keys() == set(refs)
    reached, waiting = {main["bom-ref"]}, [main["bom-ref"]]
    while waiting:
        further = set(edges[waiting.pop()]) - reached
        reached |= further
        waiting += further
    assert reached == set(refs), "each crate is needed by one that is named"


def binaries() -> list[tuple[Product, Path]]:
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    # `make test-security` builds a rig with DDS Security in a folder of its own.
    secured = ROOT / "target" / "security" / "release" / "rig"
    paths = (Path(irt._labsim.__file__), target / "release" / "rig", secured)
    return list(zip(PRODUCTS, paths, strict=True))


@pytest.mark.parametrize(("product", "binary"), binaries(), ids=lambda one: getattr(one, "name", ""))
def test_crates_in_a_binary_are_in_its_bill(product: Product, binary: Path) -> None:
    if not binary.exists():
        pytest.skip(f"{binary.name} is not built")
    found = {(name.decode(), version.decode()) for name, version in _PLACE.findall(binary.read_bytes())}
    assert len(found) > 10
    bill = json.loads(product.path.read_text(encoding="utf-8"))
    named = {(one["name"], one["version"]) for one in bill["components"] if one["scope"] == "required"}
    assert not found - named


def test_macros_and_what_they_need_are_not_built_in() -> None:
    root, macro = Crate("root", "1.0.0", "MIT", False), Crate("macro", "1.0.0", "MIT", True)
    parser, shared = Crate("parser", "1.0.0", "MIT", False), Crate("shared", "1.0.0", "MIT", False)
    graph = {root: {macro, shared}, macro: {parser, shared}, parser: set(), shared: set()}
    assert built_in(root, graph) == {root, shared}


def wheel_of(folder: Path, year: int = 1980, **files: str) -> Path:
    folder.mkdir()
    wheel = folder / "labsim_irt-0.1.0-cp311-abi3-linux_x86_64.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in files.items():
            archive.writestr(zipfile.ZipInfo(name, (year, 1, 1, 0, 0, 0)), text)
    return wheel


def test_differences_of_wheels_are_found(tmp_path: Path) -> None:
    one = wheel_of(tmp_path / "one", a="1", b="2")
    assert check_wheel.differences(one, wheel_of(tmp_path / "same", a="1", b="2")) == []
    assert check_wheel.differences(one, wheel_of(tmp_path / "other", a="1", b="3", c="4")) == ["b", "c"]
    (said,) = check_wheel.differences(one, wheel_of(tmp_path / "later", 1990, a="1", b="2"))
    assert "other dates" in said


def test_a_path_and_a_missing_bill_are_found_in_a_wheel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_wheel, "audited_tag", lambda wheel: "manylinux_2_34_x86_64")
    wheel = wheel_of(tmp_path / "one", a=f"panicked at {tmp_path}/x.rs", b="2")
    mistakes = check_wheel.mistakes(wheel, [tmp_path])
    assert mistakes[0] == "a holds a path of this machine"
    assert "the bills of materials are []" in mistakes[1]
