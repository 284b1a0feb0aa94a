"""Problems of a file in one line: the first ones by name, and the number of the others."""

import pytest
from pydantic import BaseModel, ConfigDict, ValidationError

from gantrysim.base.input_files import one_line


class Settings(BaseModel):
    model_config = ConfigDict(extra="forbid")

    speed: float = 0.0
    size: int = 0
    name: str = ""


def line_of(content, *arguments):
    with pytest.raises(ValidationError) as refused:
        Settings.model_validate(content)
    return one_line(refused.value, *arguments)


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 20])
def test_eight_problems_are_named_and_the_others_counted(count):
    texts = line_of({f"key{k}": k for k in range(count)}).split("; ")
    assert texts[: min(count, 8)] == [f"unknown key key{k}" for k in range(min(count, 8))]
    assert texts[8:] == ([f"and {count - 8} more"] if count > 8 else [])


@pytest.mark.parametrize(("count", "named"), [(1, 1), (4, 4), (5, 4), (9, 4)])
def test_a_line_has_four_hundred_characters_of_problems(count, named):
    """Of a long key 80 characters are named: with the words about them 95, and two between problems."""
    texts = line_of({f"{k}{'a' * 100}": k for k in range(count)}).split("; ")
    assert texts[:named] == [f"unknown key {k}{'a' * 79}..." for k in range(named)]
    assert texts[named:] == ([f"and {count - named} more"] if count > named else [])


def test_an_unknown_key_is_told_what_it_means_or_where_all_are_listed():
    names = ("speed", "size", "name")
    assert line_of({"sped": 1.0}, names) == "unknown key sped: did you mean speed or size?"
    assert line_of({"speed": "fast"}, names, "see the list").startswith("speed = 'fast': must be a number")
    assert "see the list" not in line_of({"speed": "fast"}, names, "see the list")
    assert line_of({"sped": 1.0}, names, "see the list") == "unknown key sped: did you mean speed or size? see the list"
    assert line_of({"zzz": 1.0}, names, "see the list").endswith("; see the list")


@pytest.mark.parametrize("count", [20, 21])
def test_up_to_twenty_keys_are_listed_where_another_place_lists_them_too(count):
    names = [f"key{k:02}" for k in range(count)]
    listed = f": known: {', '.join(names)}"
    assert line_of({"zzz": 1.0}, names) == f"unknown key zzz{listed}"
    beside = line_of({"zzz": 1.0}, names, "see the list")
    assert beside == f"unknown key zzz{listed if count == 20 else ''}; see the list"
