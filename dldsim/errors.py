"""The one exception that users are meant to read; it carries facts, and a text made of them."""

from collections.abc import Sequence
from typing import Any


class DldsimError(Exception):
    """A problem that the user can mend; its text says what, where, why and what next.

    ``key``: the setting, field, column or file that is at fault, by its name in the input, or
    several; ``value``: what it holds; ``allowed``: what it may hold; ``remedy``: what to do.
    The text is ``what``, by default made of key, value and allowed, and the remedy.

    ``faults``: where several things are wrong, one error for each; else the error alone.
    """

    def __init__(
        self,
        what: str = "",
        *,
        key: str | Sequence[str] = (),
        value: Any = None,
        allowed: str = "",
        remedy: str = "",
        faults: Sequence["DldsimError"] = (),
    ):
        self.keys = (key,) if isinstance(key, str) else tuple(key)
        self.value, self.allowed, self.remedy = value, allowed, remedy
        self.faults = tuple(faults) or (self,)
        what = what or f"{', '.join(self.keys)} = {value}: allowed {allowed}."
        super().__init__(f"{what} {remedy}" if remedy else what)

    def __reduce__(self):
        return _restored, (
            type(self),
            str(self),
            self.__dict__ | {"faults": () if self.faults == (self,) else self.faults},
        )

    @property
    def key(self) -> str:
        """The first of the keys, empty for a problem without one."""
        return self.keys[0] if self.keys else ""


def _restored(kind: type[DldsimError], text: str, facts: dict) -> DldsimError:
    error = kind(text)
    error.__dict__.update(facts)
    error.faults = error.faults or (error,)
    return error


class NoRoom(DldsimError):
    """The cell does not fit at its place of release."""
