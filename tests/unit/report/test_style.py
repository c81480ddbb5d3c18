import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.errors import IrtError
from irt.report import style


def draw(path, title="a title"):
    with style.drawing(path, 3.0, 2.0) as figure:
        axes = figure.subplots()
        axes.plot([0, 1], [0, 1])
        axes.set_title(title)


@pytest.mark.parametrize(("name", "begins"), [("a.svg", b"<?xml"), ("a.PNG", b"\x89PNG")])
def test_suffix_chooses_the_format(tmp_path, name, begins):
    draw(tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(begins)


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_same_drawing_gives_same_bytes(tmp_path, suffix):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        draw(tmp_path / folder / f"a.{suffix}")
    assert (tmp_path / "one" / f"a.{suffix}").read_bytes() == (tmp_path / "two" / f"a.{suffix}").read_bytes()


def test_unknown_suffix_is_refused_before_drawing(tmp_path):
    with (
        pytest.raises(IrtError, match=r"a\.bmp: pictures are written as \.svg or \.png"),
        style.drawing(tmp_path / "a.bmp", 1.0, 1.0),
    ):
        pytest.fail("drew all the same")


def test_unwritable_folder_is_named(tmp_path):
    with pytest.raises(IrtError, match="nowhere"):
        draw(tmp_path / "nowhere" / "a.svg")


def test_failed_drawing_leaves_the_old_picture(tmp_path):
    path = tmp_path / "a.svg"
    path.write_text("old")
    with pytest.raises(RuntimeError), style.drawing(path, 1.0, 1.0):
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_settings_of_matplotlib_stay_as_they_were(tmp_path):
    before = dict(mpl.rcParams)
    draw(tmp_path / "a.svg")
    assert dict(mpl.rcParams) == before


def test_names_of_files_are_no_mathematics(tmp_path):
    draw(tmp_path / "a.svg", title="run_$1^2$ <b>")
    assert "run_$1^2$ &lt;b&gt;" in (tmp_path / "a.svg").read_text()


def test_every_colour_has_one_role():
    assert len(set(style.COLOURS.values())) == len(style.COLOURS)


@given(
    st.lists(st.tuples(st.floats(-10, 10), st.floats(0.01, 3)), max_size=8).map(
        lambda labels: sorted(labels, key=lambda label: label[0])
    )
)
def test_spread_labels_keep_their_order_and_do_not_overlap(labels):
    heights, sizes = [h for h, _ in labels], [s for _, s in labels]
    centres = style.spread(heights, sizes)
    assert len(centres) == len(labels)
    gaps = np.diff(centres) - (np.array(sizes[1:]) + sizes[:-1]) / 2 if labels else np.zeros(0)
    assert (gaps > -1e-9).all()


def test_labels_with_room_stay_where_they_are():
    assert style.spread([0.0, 1.0, 2.0], [0.5, 0.5, 0.5]) == [0.0, 1.0, 2.0]


def test_labels_without_room_share_the_way():
    assert style.spread([1.0, 1.0], [0.5, 0.5]) == pytest.approx([0.75, 1.25])


def test_labels_stand_at_the_ends_of_their_lines(tmp_path):
    with style.drawing(tmp_path / "a.svg", 3.0, 2.0) as figure:
        axes = figure.subplots()
        axes.plot([0, 1], [0, 100])
        axes.plot([0, 1], [0, 50])
        style.label_ends(axes, [(100, "steep", style.TUNED), (50, "flat", style.INK)])
        flat, steep = axes.texts
        low, high = axes.get_ylim()
    assert (flat.get_text(), steep.get_text()) == ("flat", "steep")
    assert flat.get_position()[1] == pytest.approx((50 - low) / (high - low))
    assert steep.get_position()[1] == pytest.approx((100 - low) / (high - low))


def test_a_long_name_keeps_both_ends():
    assert style.shortened("run-1", 10) == "run-1"
    name = f"2026-11-24_{'x' * 50}_take-7"
    short = style.shortened(name, 21)
    assert len(short) == 21
    assert short.startswith("2026-11-24")
    assert short.endswith("_take-7")
