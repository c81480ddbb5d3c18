"""One way through the package: a layer imports only from those below it, and heavy packages load late."""

import ast
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "python" / "irt"

# Top to bottom. A new module takes its place here, above all that it uses.
LAYERS = (
    "__main__",
    "cli",
    "environment",
    "export",
    "paper",
    "proof",
    "importing",
    "report",
    "suggestion",
    "diagnosis",
    "tuning",
    "checking",
    "fitting",
    "residual",
    "tilt_errors",
    "sessions",
    "measured_tilt",
    "segments",
    "start_state",
    "model",
    "posterior",
    "engine",
    "tracking",
    "rig",
    "maze",
    "dimensions",
    "recording",
    "validity",
    "columns",
    "conventions",
    "path_length",
    "cleaning",
    "bag",
    "files",
    "catalogue",
    "workers",
    "pictures",
    "display",
    "methods",
    "values",
    "arguments",
    "extras",
    "errors",
)
EXTENSION = "irt._labsim"
HEAVY = {
    "cv2",
    "cyclonedds",
    "gymnasium",
    "jinja2",
    "matplotlib",
    "mcap",
    "mcap_ros2",
    "playwright",
    "pybullet",
    "pysindy",
    "ray",
    "rosbags",
    "sbi",
    "scipy",
    "torch",
}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imports(name: str, path: Path) -> Iterator[str]:
    """Full names of the irt modules that a file imports anywhere: at the top, in functions, for types."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            source = importlib.util.resolve_name(base, package) if node.level else base
            submodules = [f"{source}.{alias.name}" for alias in node.names]
            found = [sub if sub in SOURCES or sub == EXTENSION else source for sub in submodules]
        else:
            continue
        yield from (module for module in found if module.split(".")[0] == "irt" and module != name)


@cache
def graph() -> dict[str, set[str]]:
    return {name: set(imports(name, path)) for name, path in SOURCES.items()}


def layer(module: str) -> str:
    return module.split(".")[1]


def test_every_module_has_a_layer() -> None:
    unplaced = {name for name in SOURCES if name != "irt" and layer(name) not in LAYERS}
    assert not unplaced, f"give these a place in LAYERS: {sorted(unplaced)}"


@pytest.mark.parametrize("name", sorted(SOURCES.keys() - {"irt"}))
def test_imports_point_down(name: str) -> None:
    below = set(LAYERS[LAYERS.index(layer(name)) + 1 :])
    for target in graph()[name] - {EXTENSION}:
        # `import irt` reaches every layer at once, so a layer that used it would import upwards.
        assert target != "irt", f"{name} imports the package itself: import the module that it needs"
        assert layer(target) == layer(name) or layer(target) in below, f"{name} imports {target} from above"


def test_no_import_cycles() -> None:
    TopologicalSorter(graph()).prepare()


def test_four_doors_lead_to_the_engine() -> None:
    doors = {name for name, targets in graph().items() if EXTENSION in targets}
    assert doors == {"irt.engine", "irt.catalogue", "irt.fitting.problem", "irt.environment.vector"}


def loaded_after(statement: str) -> set[str]:
    """Run a statement in a new interpreter; return the top-level packages that it loaded."""
    script = f"import sys\n{statement}\nprint(*sys.modules, file=sys.stderr)"
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return {module.split(".")[0] for module in ran.stderr.split()}


HELP = """
import sys
from irt.cli.__main__ import main
sys.argv = ["irt", "--help"]
try:
    main()
except SystemExit as stop:
    assert not stop.code, stop.code
"""


@pytest.mark.parametrize("statement", ["import irt", HELP], ids=["import irt", "irt --help"])
def test_heavy_packages_load_only_where_used(statement: str) -> None:
    loaded = loaded_after(statement)
    assert "irt" in loaded
    assert not loaded & HEAVY


def test_fits_and_diagnoses_load_without_distributions() -> None:
    """`scipy.stats` takes as long to load as all else that they need."""
    modules = "import irt.diagnosis, irt.suggestion, irt.tuning.drive"
    assert "scipy" in loaded_after(f"{modules}; assert 'scipy.stats' not in sys.modules")


def test_help_answers_at_once() -> None:
    resource = pytest.importorskip("resource", reason="processor time of a child is read the Unix way")

    def seconds() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", HELP], capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return float(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)

    # Processor time, and one of several: what other programs take from the machine is not measured.
    assert any(seconds() < 0.3 for _ in range(5))


CRATE = PACKAGE.parents[1] / "crates" / "labsim" / "src"


def rust_module(path: Path) -> tuple[str, ...]:
    parts = path.relative_to(CRATE).with_suffix("").parts
    return parts[:-1] if parts[-1] in ("mod", "lib") else parts


RUST = {rust_module(path): path for path in sorted(CRATE.rglob("*.rs")) if path.stem != "tests"}


def paths_in(tree: str) -> Iterator[str]:
    """Expand `a::{b, c::{d, e}}` into the paths that it names."""
    head, brace, rest = tree.partition("{")
    if not brace:
        yield tree.strip()
        return
    depth, begin = 0, 0
    inner = rest[: rest.rindex("}")]
    for place, letter in enumerate([*inner, ","]):
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            yield from (head.strip() + path for path in paths_in(inner[begin:place]))
            begin = place + 1


def rust_imports(module: tuple[str, ...], path: Path) -> Iterator[tuple[str, ...]]:
    """Modules that a source file uses outside its tests."""
    code = re.sub(r"//.*", "", path.read_text(encoding="utf-8")).split("#[cfg(test)]")[0]
    trees = re.findall(r"\buse ((?:crate|super|self)::[^;]+);", code)
    inline = re.findall(r"(?<!use )\b(?:crate|super)(?:::\w+)+", code)
    for name in [name for tree in [*trees, *inline] for name in paths_in(tree)]:
        root, *rest = re.sub(r"\s", "", name).split("::")
        start = {"crate": (), "self": module, "super": module[:-1]}[root]
        target = (*start, *rest)
        while target and target not in RUST:
            target = target[:-1]
        yield target


@pytest.mark.parametrize("folder", sorted({module[:-1] for module in RUST if module}), ids="::".join)
def test_no_cycles_among_the_modules_of_a_rust_folder(folder: tuple[str, ...]) -> None:
    graph: dict[str, set[str]] = {}
    for module, path in RUST.items():
        if module[: len(folder)] != folder or len(module) == len(folder):
            continue
        own = module[len(folder)]
        for target in rust_imports(module, path):
            if target[: len(folder)] == folder and len(target) > len(folder) and target[len(folder)] != own:
                graph.setdefault(own, set()).add(target[len(folder)])
    TopologicalSorter(graph).prepare()
