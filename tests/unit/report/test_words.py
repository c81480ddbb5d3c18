import math

import pytest

from irt.display import listed
from irt.model import Parameter
from irt.report.words import (
    change,
    commands,
    counted,
    duration,
    explained,
    in_rows,
    labelled,
    millimetres,
    p_value,
    percent,
    probability,
    quantity,
    share,
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
def test_errors_are_given_in_two_digits(error, text):
    assert percent(error) == text.replace(" ", "\N{NO-BREAK SPACE}")


def test_commands_in_a_sentence_are_code_and_the_rest_is_escaped():
    said = commands("a < b: run `irt suggest <rig>` next")
    assert said == "a &lt; b: run <code>irt suggest &lt;rig&gt;</code> next"


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
        (Parameter(20.0, -math.inf, math.inf), "20  (not identifiable)"),
    ],
)
def test_open_intervals_are_given_in_words(parameter, text):
    assert with_interval(parameter) == text


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        (0.041, 0.013, "3.2* smaller"),
        (0.041, 0.001, "41* smaller"),
        (0.5, 0.0004, "1,200* smaller"),
        (0.1, 0.098, "unchanged"),
        (0.098, 0.1, "unchanged"),
        (0.1, 0.25, "2.5* larger"),
        (0.1, 0.0, "-"),
        (math.nan, 0.1, "-"),
    ],
)
def test_ratios_of_errors(before, after, text):
    assert change(before, after) == text.replace("*", "\N{MULTIPLICATION SIGN}")


@pytest.mark.parametrize(
    ("probability", "text"),
    [
        (0.31, "0.3"),
        (0.005, "0.005"),
        (2.4e-4, "0.0002"),
        (1e-9, "< 0.000001"),
        (0.0, "< 0.000001"),
        (math.nan, "-"),
    ],
)
def test_p_values_have_one_digit(probability, text):
    assert p_value(probability) == text


def test_share_of_the_error_that_is_explained_lies_between_floor_and_start():
    assert explained(0.05, 0.01, 0.01) == 1.0
    assert explained(0.05, 0.03, 0.01) == pytest.approx(0.5)
    assert explained(0.05, 0.06, 0.01) == 0.0
    assert explained(0.05, 0.005, 0.01) == 1.0
    assert math.isnan(explained(0.0101, 0.01, 0.01))


@pytest.mark.parametrize(
    ("part", "text"),
    [(0.0, "0 %"), (0.001, "< 1 %"), (0.006, "1 %"), (0.424, "42 %"), (0.9979, "99.7 %"), (1.0, "100 %")],
)
def test_a_share_is_neither_all_nor_nothing_unless_it_is(part, text):
    assert share(part).replace("\N{NO-BREAK SPACE}", " ") == text


@pytest.mark.parametrize(
    ("chance", "text"),
    [(0.0, "< 0.1 %"), (0.0123, "1.2 %"), (0.62, "62 %"), (0.989, "98.9 %"), (1.0, "> 99.9 %")],
)
def test_no_probability_is_certainty(chance, text):
    assert probability(chance).replace("\N{NO-BREAK SPACE}", " ") == text


def test_without_stamps_lengths_are_rows():
    assert duration(120, 12.43) == f"12.4{NO_BREAK}s"
    assert duration(120) == "120 rows"


@pytest.mark.parametrize(
    ("name", "unit", "value", "rows", "renamed"),
    [
        ("delay_s", "s", 10.0, "rows", "delay"),
        ("limit_m_per_s", "m/s", 0.4, "m/row", "limit_m_per_row"),
        ("push_m_per_s2", "m/s²", 0.08, "m/row²", "push_m_per_row2"),
        ("tilt", "rad s/m", 10.0, "rad row/m", "tilt"),
        ("width_x_rad", "rad", 2.0, "rad", "width_x_rad"),
        ("ratio_s", "", 2.0, "", "ratio_s"),
    ],
)
def test_seconds_become_rows_in_every_unit(name, unit, value, rows, renamed):
    said, shown, known = in_rows(name, Parameter(2.0, 1.0, 3.0), unit, 0.2)
    assert (said, shown.value, known) == (renamed, pytest.approx(value), rows)
    # An interval in seconds is one of the time scale too, which rows do not need.
    assert (shown.low is None) == ("row" in rows)


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
