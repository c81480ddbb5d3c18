from __future__ import annotations

import os
import stat
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from irt.errors import IrtError
from irt.files import (
    atomic_folder,
    atomic_path,
    make_folder,
    read_text,
    read_toml,
    remove_unfinished,
    write_atomic,
)

NOT_ROOT = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere"
)


def test_write_atomic_replaces_the_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_atomic(path, "longer text than the next")
    write_atomic(path, "Grüße")
    assert path.read_text(encoding="utf-8") == "Grüße"
    write_atomic(path, b"\x00\xff")
    assert path.read_bytes() == b"\x00\xff"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_failed_write_leaves_the_old_file_and_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_atomic(path, "old")

    def fail() -> None:
        with atomic_path(path) as beside:
            beside.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_is_replaced_as_a_whole_or_not_at_all(tmp_path: Path) -> None:
    folder = tmp_path / "rig"
    folder.mkdir()
    (folder / "old.csv").write_text("old")

    def fail() -> None:
        with atomic_folder(folder) as beside:
            (beside / "half.csv").write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert [path.name for path in tmp_path.rglob("*")] == ["rig", "old.csv"]
    with atomic_folder(folder) as beside:
        (beside / "new.csv").write_text("new")
        assert (folder / "old.csv").exists()
    assert [path.name for path in tmp_path.rglob("*")] == ["rig", "new.csv"]


def test_folders_of_a_killed_process_are_removed(tmp_path: Path) -> None:
    killed = atomic_folder(tmp_path / "rig")
    beside = killed.__enter__()
    (beside / "half.csv").write_text("half")
    (tmp_path / "other").mkdir()
    remove_unfinished(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["other"]


def test_an_error_of_the_disk_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with pytest.raises(IrtError, match=r"a\.txt: cannot be written: No space left"), atomic_path(path):
        raise OSError(28, "No space left on device")


def test_the_path_beside_keeps_the_suffix(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "plot.svg") as beside:
        assert beside.suffix == ".svg"
        assert beside.parent == tmp_path
        beside.write_text("<svg/>")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such permissions")
def test_a_written_file_has_the_permissions_of_any_other(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("x")
    write_atomic(tmp_path / "ours", "x")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "ours")]
    assert modes[0] == modes[1]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    link = tmp_path / "link"
    link.symlink_to("real")
    write_atomic(link, "new")
    assert link.is_symlink()
    assert (tmp_path / "real").read_text() == "new"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_written_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    write_atomic(pipe, "through")
    reader.join(timeout=60)
    assert read == ["through"]
    assert pipe.is_fifo()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (".", "cannot be written: it is a folder"),
        ("/", "cannot be written: it is a folder"),
        ("none/a.txt", "cannot be written: there is no folder"),
        ("file/a.txt", "cannot be written: there is no folder"),
        ("x" * 300, "cannot be written: File name too long"),
    ],
)
def test_unwritable(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(IrtError, match=message):
        write_atomic(tmp_path / name, "x")


@NOT_ROOT
def test_a_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(IrtError, match="Permission denied"):
        write_atomic(tmp_path / "a.txt", "x")
    with pytest.raises(IrtError, match="nothing can be written into this folder"):
        make_folder(tmp_path)


def test_make_folder_makes_its_parents(tmp_path: Path) -> None:
    assert make_folder(tmp_path / "a" / "b").is_dir()
    assert make_folder(tmp_path / "a" / "b").is_dir()


def test_make_folder_over_a_file(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("x")
    with pytest.raises(IrtError, match=r"the folder cannot be made: .*a is a file; choose another"):
        make_folder(tmp_path / "a")
    with pytest.raises(IrtError, match=r"b: the folder cannot be made: .*a is a file; choose another"):
        make_folder(tmp_path / "a" / "b")


def test_read_text_drops_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbfa\r\nb")
    assert read_text(path) == "a\r\nb"


def test_what_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(IrtError, match=r"none\.csv: no such file"):
        read_text(tmp_path / "none.csv")
    with pytest.raises(IrtError, match="is a folder, where a file was expected"):
        read_text(tmp_path)
    (tmp_path / "latin").write_bytes("a\nb\nGrüße".encode("latin-1"))
    with pytest.raises(IrtError, match="latin, line 3: not UTF-8 text; save the file as UTF-8"):
        read_text(tmp_path / "latin")


def test_broken_toml_names_line_and_column(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("[board]\nedge_x_m 3\n")
    with pytest.raises(IrtError, match=r"rig\.toml: broken TOML: .*line 2, column 10"):
        read_toml(path)


@pytest.mark.parametrize("text", ["a = " + "[" * 5000, "a = " + "9" * 5000], ids=["brackets", "digits"])
def test_toml_that_overwhelms_the_parser(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(IrtError, match=r"rig\.toml: broken TOML"):
        read_toml(path)


@given(st.binary())
def test_any_bytes_are_toml_or_refused(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "garbage.toml"
    path.write_bytes(data)
    with suppress(IrtError):
        read_toml(path)


class TestTomlTable:
    @pytest.fixture
    def table(self, tmp_path: Path):
        path = tmp_path / "a.toml"
        path.write_text(
            'truth = true\nword = "x"\nbig = inf\nnone = nan\nfar = 1'
            + "0" * 400
            + "\nwhole = 3\nhalf = 0.5\n"
            "pair = [1, 2.5]\nlong = [1, 2, 3]\nmixed = [1, 'x']\n[section]\na = 1\n[[items]]\nb = 2\n"
        )
        return read_toml(path)

    def test_numbers(self, table) -> None:
        assert table.number("whole") == 3.0
        assert isinstance(table.number("whole"), float)
        assert table.numbers("whole", "half", "absent") == {"whole": 3.0, "half": 0.5}
        assert table.pair("pair") == (1.0, 2.5)

    @pytest.mark.parametrize(
        ("key", "message"),
        [
            ("truth", "truth: expected a number, found True"),
            ("word", 'word: expected a number, found "x"'),
            ("big", "big: expected a finite number, found inf"),
            ("none", "none: expected a finite number, found nan"),
            ("far", r"far: expected a finite number, found 1000+\.\.\."),
            ("pair", r"pair: expected a number, found \[1, 2\.5\]"),
            ("absent", r"a\.toml: absent is missing"),
        ],
    )
    def test_what_is_no_number(self, table, key: str, message: str) -> None:
        with pytest.raises(IrtError, match=message):
            table.number(key)

    @pytest.mark.parametrize("key", ["long", "mixed", "whole", "absent"])
    def test_what_is_no_pair(self, table, key: str) -> None:
        with pytest.raises(IrtError, match="expected"):
            table.pair(key)

    def test_sections(self, table) -> None:
        assert table.section("section").number("a") == 1.0
        assert not table.section("absent").content
        assert [item.number("b") for item in table.sections("items")] == [2.0]
        assert table.sections("absent") == []
        assert table.inline("section", "{ a = 1 }").number("a") == 1.0

    def test_what_is_no_section(self, table) -> None:
        with pytest.raises(IrtError, match=r"whole: expected a section \[whole\], found 3"):
            table.section("whole")
        with pytest.raises(IrtError, match=r"pair: expected sections \[\[pair\]\]"):
            table.sections("pair")
        with pytest.raises(IrtError, match=r"whole: expected \{ a = 1 \}, found 3"):
            table.inline("whole", "{ a = 1 }")

    def test_words(self, table) -> None:
        assert table.word("word") == "x"
        with pytest.raises(IrtError, match="whole: expected text in quotes, found 3"):
            table.word("whole")
        with pytest.raises(IrtError, match="absent is missing"):
            table.word("absent")

    def test_unknown_keys_are_named_with_what_is_possible(self, table) -> None:
        with pytest.raises(IrtError, match=r'section\]: unknown key "a"; possible: b, c'):
            table.section("section").only("key", ("b", "c"))
