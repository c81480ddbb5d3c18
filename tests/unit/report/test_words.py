import math

import pytest

from irt.model import Parameter
from irt.report.words import (
    counted,
    labelled,
    listed,
    millimetres,
    odds,
    percent,
    quantity,
    times_less,
    together,
    with_interval,
)

NO_BREAK = "\N{NO-BREAK SPACE}"


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (0.2134, "21 %"),
        (0.0994, "9.9 %"),
        (0.0402, "4.0 %"),
        (0.00164, "0.16 %"),
        (0.0, "0.0 %"),
        (2.0, "200 %"),
    ],
)
def test_errors_are_told_in_two_digits(error, text):
    assert percent(error) == text.replace(" ", "\N{NO-BREAK SPACE}")


def test_an_error_of_nothing_is_a_dash():
    assert percent(math.nan) == "-"


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        (Parameter(0.0420349, 0.0410, 0.0431), "0.0420  (0.0410 to 0.0431)"),
        (Parameter(16.04, 12.3, 19.9), "16.0  (12.3 to 19.9)"),
        (Parameter(1042.4, 12.3, 3000.9), "1042  (12 to 3001)"),
        (Parameter(0.5, 0.5, 0.5), "0.500000  (0.500000 to 0.500000)"),
        (Parameter(-1e-6, -0.02, 1e-5), "0.000  (-0.020 to 0.000)"),
        (Parameter(0.0420349), "0.04203"),
    ],
)
def test_values_keep_the_digits_that_their_interval_leaves(parameter, text):
    assert with_interval(parameter) == text


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        (Parameter(20.0, 3.0, math.inf), "20  (at least 3)"),
        (Parameter(20.0, -math.inf, 30.0), "20  (at most 30)"),
        (Parameter(20.0, -math.inf, math.inf), "20  (not pinned down)"),
    ],
)
def test_open_intervals_are_told_in_words(parameter, text):
    assert with_interval(parameter) == text


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        (0.041, 0.013, "3.2 times less"),
        (0.041, 0.001, "41 times less"),
        (0.5, 0.0004, "1,200 times less"),
        (0.1, 0.098, "no less"),
        (0.098, 0.1, "no less"),
        (0.1, 0.25, "2.5 times more"),
        (0.1, 0.0, "-"),
        (math.nan, 0.1, "-"),
    ],
)
def test_ratios_of_errors_are_told_as_times(before, after, text):
    assert times_less(before, after) == text


@pytest.mark.parametrize(
    ("p_value", "text"),
    [
        (0.31, "1 in 3"),
        (2e-4, "1 in 5,000"),
        (1e-9, "less than 1 in a million"),
        (0.0, "less than 1 in a million"),
        (0.9, "more often than not"),
        (math.nan, "-"),
    ],
)
def test_chance_is_told_as_one_in(p_value, text):
    assert odds(p_value) == text


def test_units_stand_with_their_numbers():
    assert millimetres(0.0536, 0.276) == f"15{NO_BREAK}mm"
    assert quantity(0.0312, "rad") == f"0.0312{NO_BREAK}rad"
    assert quantity(2.0, "") == "2"
    assert labelled("width_x_rad", "rad") == "width_x_rad [rad]"
    assert labelled("gear_x", "") == "gear_x"


def test_lists_read_as_sentences():
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"], "or") == "a, b or c"
    assert together(["dead_band", "lag"]) == "dead band + lag"
    assert together([]) == "nothing added"
    assert [counted(number, "row") for number in (1, 1200)] == ["1 row", "1,200 rows"]
