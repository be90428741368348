"""Value objects of which the loop makes many in each cycle."""

from typing import TYPE_CHECKING, TypeVar

__all__ = ["record"]

if TYPE_CHECKING:
    from dataclasses import dataclass as record
else:
    from dataclasses import dataclass

    ClassT = TypeVar("ClassT")

    def record(*, frozen: bool, slots: bool, kw_only: bool = False):
        """Return the `dataclass` decorator, with a check of `frozen` by the type checker only.

        Python checks `frozen` at each assignment, those of the constructor too: it then takes three times as
        long. Use it as `record(frozen=True, slots=True)` for what is made in each cycle, `dataclass`
        elsewhere.
        """

        def decorate(cls: type[ClassT]) -> type[ClassT]:
            return dataclass(slots=slots, kw_only=kw_only, unsafe_hash=frozen)(cls)

        return decorate
