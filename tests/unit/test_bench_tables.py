"""The tables of what was measured: medians, spreads, ratios, and what is said where something is missing."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from table.criterion import effects_table, read_timings
from table.peers import fit_table, growth_table, peers_table
from table.words import Measured, duration, significant

SCRIPT = Path(__file__).resolve().parents[2] / "benches" / "write_table.py"
PAPER = {"rollouts": 20_000, "substeps": 50_000_000}


def rows(table):
    """Cells of a Markdown table's rows, without its head."""
    lines = [line for line in table.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def engine(name, threads, seconds, *, rollouts=100, substeps=1_000_000, path_mean=0.0):
    return {
        "name": name,
        "threads": threads,
        "rollouts": rollouts,
        "substeps": substeps,
        "path_mean": path_mean,
        "path_max": path_mean,
        "seconds": seconds,
    }


def results(**parts):
    return {
        "machine": "a machine",
        "busy": 0.1,
        "versions": {"PyBullet": "3.2.7", "pycma": "4.5.0"},
        "absent": {"engines": {}, "fits": {}},
        "paper": PAPER,
        "fit_noise": 0.001,
        **parts,
    }


def run(method, seconds, *, close=None, arrived=None):
    return {
        "method": method,
        "start": 0,
        "seconds": seconds,
        "rollouts": 100,
        "error": 0.001,
        "close": close,
        "arrived": arrived,
    }


def test_spread_is_the_standard_deviation_of_normal_samples_with_any_outliers():
    samples = np.random.default_rng(0).normal(10.0, 0.5, 20_001)
    samples[:100] = 1e6
    found = Measured.of(samples.tolist())
    assert found.median == pytest.approx(10.0, abs=0.02)
    assert found.spread == pytest.approx(0.5, rel=0.03)


def test_ratio_of_independent_measurements_has_both_spreads():
    ratio = Measured(6.0, 0.3).over(Measured(2.0, 0.2))
    assert ratio.median == 3.0
    assert ratio.spread == pytest.approx(3.0 * math.hypot(0.05, 0.1))


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (2e-9, "2 ns"),
        (1.5e-6, "1.5 µs"),
        (0.0123, "12.3 ms"),
        (1.0, "1 s"),
        (372.4, "372 s"),
        (123456.0, "123,000 s"),
    ],
)
def test_times_come_in_the_unit_that_suits_them(seconds, text):
    assert duration(seconds) == text


def test_numbers_have_three_digits_and_no_exponent():
    assert [significant(n) for n in (0.012345, 1234.5, 99999.0)] == ["0.0123", "1230", "100,000"]


def test_ratios_are_of_the_same_round():
    """A machine twice as slow in one round slows both engines, and not their ratio."""
    bullet = engine("PyBullet", 2, [1.0, 2.0, 1.0])
    fast = engine("rolling", 2, [0.001, 0.002, 0.001])
    found = rows(peers_table(results(throughput=[bullet, fast])))
    assert found[1][-1] == "1000 ± 0.0 %"
    assert found[0][-1] == "1 ± 0.0 %"


def test_engines_are_named_with_version_and_workers_and_extrapolated_times_marked():
    engines = [
        engine("PyBullet", 1, [1.0]),
        engine("PyBullet", 2, [0.5]),
        engine("rolling", 2, [0.5], rollouts=20_000, substeps=50_000_000),
    ]
    found = rows(peers_table(results(throughput=engines)))
    assert [row[0] for row in found] == [
        "PyBullet 3.2.7, 1 process",
        "PyBullet 3.2.7, 2 processes",
        "rolling, 2 threads",
    ]
    assert [row[3] for row in found] == ["50 s \\*", "25 s \\*", "500 ms"]
    assert [row[1] for row in found] == ["1 M", "2 M", "100 M"]


def test_without_pybullet_there_is_no_ratio_to_it_and_the_page_says_why():
    absent = {"engines": {"PyBullet": "No module named 'pybullet'"}, "fits": {}}
    table = peers_table(results(throughput=[engine("rapier", 2, [1.0])], absent=absent))
    assert "times PyBullet" not in table
    assert "times rapier, 2 threads" in table
    assert "PyBullet is left out: No module named 'pybullet'." in table


def test_slope_of_linear_growth_is_one():
    sizes = [
        {"rollouts": 10**power, "seconds": [10.0 ** (power - 6)] * 3, "peak_mib": [90.0, 95.4]}
        for power in range(3, 7)
    ]
    table = growth_table(results(growth=sizes))
    assert "to the power of 1.000 ± 0.000" in table
    assert rows(table)[-1] == ["1,000,000", "1 s", "± 0.0 %", "95 MiB"]


def test_slope_of_quadratic_growth_is_two():
    sizes = [{"rollouts": n, "seconds": [n**2 / 1e6], "peak_mib": [90.0]} for n in (1000, 10_000, 100_000)]
    assert "to the power of 2.000" in growth_table(results(growth=sizes))


def test_failed_runs_count_for_the_time_with_restarts_alone():
    runs = [
        run("pycma", 1.0, close=(0.5, 10), arrived=(1.0, 20)),
        run("pycma", 7.0, close=(0.7, 30)),
        run("pycma", 1.0, close=(0.6, 10), arrived=(1.0, 40)),
        run("other", 3.0),
    ]
    race = {"recordings": "off the rim", "floor": 0.001, "runs": runs}
    cma, other = rows(fit_table(results(fits=[race])))
    assert cma == ["pycma 4.5.0", "2 of 3", "600 ms ± 24.7 %", "1 s ± 0.0 %", "30", "4.5 s"]
    assert other == ["other", "0 of 1", "never", "never", "none", "none"]


def test_a_busy_machine_is_said():
    sizes = [{"rollouts": 1000, "seconds": [1.0], "peak_mib": [90.0]}]
    assert growth_table(results(growth=sizes)).endswith("Measured on a machine.")
    busy = growth_table(results(growth=sizes, busy=1.52))
    assert busy.endswith("Measured on a machine, 1.5 of them busy with other work.")


def test_nothing_measured_makes_no_table():
    assert peers_table(results()) is None
    assert growth_table(results()) is None
    assert fit_table(results()) is None


def add_benchmark(criterion, name, median, spread):
    folder = criterion / name.replace("/", "_") / "new"
    folder.mkdir(parents=True)
    estimates = {"median": {"point_estimate": median}, "median_abs_dev": {"point_estimate": spread}}
    (folder / "benchmark.json").write_text(json.dumps({"full_id": name, "throughput": None}))
    (folder / "estimates.json").write_text(json.dumps(estimates))


def test_effects_are_given_in_multiples_of_the_base_rollout(tmp_path):
    add_benchmark(tmp_path, "effects/base", 2e6, 2e4)
    add_benchmark(tmp_path, "effects/backlash", 3e6, 0.0)
    add_benchmark(tmp_path, "effects/air_drag", 2.2e6, 0.0)
    add_benchmark(tmp_path, "rolling/1 rollout", 1e6, 0.0)
    table = effects_table(read_timings(tmp_path), "a machine")
    assert rows(table) == [
        ["air_drag", "2.2 ms", "1.1", "± 1.0 %"],
        ["backlash", "3 ms", "1.5", "± 1.0 %"],
    ]
    assert "base rollout takes 2 ms" in table


def test_each_block_is_filled_by_its_name_and_others_keep_what_they_say(tmp_path):
    (tmp_path / "peers.json").write_text(json.dumps(results(throughput=[engine("rapier", 2, [1.0])])))
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- bench:fit -->\nold fit\n<!-- /bench -->\n\nbetween\n\n"
        "<!-- bench:peers -->\nold peers\n<!-- /bench -->\nend\n"
    )
    command = [
        sys.executable,
        str(SCRIPT),
        "--criterion",
        "none",
        "--peers",
        "peers.json",
        "--page",
        "page.md",
    ]
    subprocess.run(command, cwd=tmp_path, check=True)
    text = page.read_text()
    assert text.startswith(
        "<!-- bench:fit -->\nold fit\n<!-- /bench -->\n\nbetween\n\n<!-- bench:peers -->\n\n|"
    )
    assert text.endswith("\n\n<!-- /bench -->\nend\n")
    assert "old peers" not in text
    assert "| rapier, 2 threads |" in text
