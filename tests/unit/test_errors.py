from __future__ import annotations

import pickle

import pytest

from irt.errors import IrtError, located, unknown_name


def test_message_is_one_line() -> None:
    assert str(IrtError("a file\nnamed over\r\nlines")) == "a file named over lines"


def test_is_a_value_error_that_processes_can_exchange() -> None:
    error = pickle.loads(pickle.dumps(IrtError("what")))
    assert isinstance(error, ValueError)
    assert str(error) == "what"


def test_located_says_where() -> None:
    with pytest.raises(IrtError, match=r"^rig.toml: too long$"), located("rig.toml"):
        raise IrtError("too long")


def test_located_leaves_other_errors_alone() -> None:
    with pytest.raises(KeyError), located("rig.toml"):
        raise KeyError("x")


def test_unknown_name_suggests_the_nearest() -> None:
    assert str(unknown_name("effect", "backlsh", ["delay", "backlash"])) == (
        'unknown effect "backlsh"; did you mean "backlash"? possible: delay, backlash'
    )


def test_unknown_name_without_a_near_one_lists_what_is_possible() -> None:
    assert str(unknown_name("effect", "zzz", ["delay"])) == 'unknown effect "zzz"; possible: delay'
    assert str(unknown_name("effect", "zzz", [])) == 'unknown effect "zzz"; possible: none'


def test_of_very_many_names_the_first_are_listed() -> None:
    message = str(unknown_name("parameter", "zzz", [f"name_{i}" for i in range(60)]))
    assert message.endswith("name_39, and 20 more")
