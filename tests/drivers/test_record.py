"""Value objects of a cycle."""

import copy
from dataclasses import fields, replace

import pytest

from drivers.record import record


@record(frozen=True, slots=True, kw_only=True)
class Reading:
    """A value object with a default."""

    name: str
    value: float = 0.0


def test_a_record_is_compared_and_hashed_by_its_values() -> None:
    one, same, other = Reading(name="a", value=1.0), Reading(name="a", value=1.0), Reading(name="a")
    assert one == same != other
    assert {one, same, other} == {one, other}
    assert replace(other, value=1.0) == one
    assert [field.name for field in fields(one)] == ["name", "value"]
    assert copy.deepcopy(one) == one


def test_a_record_has_no_other_attributes_and_names_its_arguments() -> None:
    with pytest.raises(AttributeError):
        Reading(name="a").unit = "m"  # type: ignore[attr-defined]
    with pytest.raises(TypeError):
        Reading("a")  # type: ignore[call-arg]


def test_the_type_checker_refuses_to_change_a_record() -> None:
    reading = Reading(name="a")
    reading.value = 2.0  # type: ignore[misc]  # mypy reports an unused comment where it does not refuse
    assert reading.value == 2.0
