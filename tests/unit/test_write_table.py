"""A table of docs/benchmarks.md is what criterion measured, and nothing else on the page changes."""

import json
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "benches" / "write_table.py"
PAGE = "# Title\n\nbefore\n\n<!-- bench:engine -->\nold table\n<!-- /bench -->\n\nafter\n"


def add_result(criterion: Path, name: str, median: float, spread: float, throughput: object) -> None:
    folder = criterion / name.replace("/", "_") / "new"
    folder.mkdir(parents=True)
    estimates = {"median": {"point_estimate": median}, "median_abs_dev": {"point_estimate": spread}}
    (folder / "benchmark.json").write_text(json.dumps({"full_id": name, "throughput": throughput}))
    (folder / "estimates.json").write_text(json.dumps(estimates))


def write_table(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), "--criterion", "criterion", "--page", "page.md"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_rows_are_sorted_and_in_readable_units(tmp_path: Path) -> None:
    criterion = tmp_path / "criterion"
    add_result(criterion, "rolling/1 thread", 50_000.0, 500.0, {"Elements": 2500})
    add_result(criterion, "rapier/2 threads", 1.25e9, 1.25e7, {"Elements": 5_000_000})
    add_result(criterion, "rolling/2 threads", 999_600.0, 0.0, {"Elements": 1_234_000})
    add_result(criterion, "rolling/10 threads", 2e9, 0.0, None)
    add_result(criterion, "drive", 999.0, 0.0, None)
    (tmp_path / "page.md").write_text(PAGE)

    assert write_table(tmp_path).returncode == 0

    rows = [line for line in (tmp_path / "page.md").read_text().splitlines() if line.startswith("|")]
    assert rows[2:] == [
        "| drive | 999 ns | ± 0.0 % |  |",
        "| rapier/2 threads | 1.25 s | ± 1.0 % | 4 M |",
        "| rolling/1 thread | 50 µs | ± 1.0 % | 50 M |",
        "| rolling/2 threads | 1000 µs | ± 0.0 % | 1230 M |",
        "| rolling/10 threads | 2 s | ± 0.0 % |  |",
    ]


def test_only_the_text_between_the_markers_changes(tmp_path: Path) -> None:
    add_result(tmp_path / "criterion", "rolling", 1e6, 1e4, None)
    (tmp_path / "page.md").write_text(PAGE)

    write_table(tmp_path)
    once = (tmp_path / "page.md").read_text()
    write_table(tmp_path)

    assert (tmp_path / "page.md").read_text() == once
    assert once.startswith("# Title\n\nbefore\n\n<!-- bench:engine -->\n")
    assert once.endswith("\n<!-- /bench -->\n\nafter\n")
    assert "old table" not in once


def test_nothing_measured_leaves_the_page_alone(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text(PAGE)

    ran = write_table(tmp_path)

    assert (ran.returncode, ran.stdout) == (1, "")
    assert "run 'cargo bench' first" in ran.stderr
    assert (tmp_path / "page.md").read_text() == PAGE


def test_a_page_without_markers_is_left_alone(tmp_path: Path) -> None:
    add_result(tmp_path / "criterion", "rolling", 1e6, 1e4, None)
    (tmp_path / "page.md").write_text("# Title\n")

    assert write_table(tmp_path).returncode == 1
    assert (tmp_path / "page.md").read_text() == "# Title\n"
