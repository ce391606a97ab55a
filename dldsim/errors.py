"""The one exception that users are meant to read."""


class DldsimError(Exception):
    """A problem that the user can mend; its text says what, where, why and what next."""


class NoRoom(DldsimError):
    """The cell does not fit at its place of release."""
