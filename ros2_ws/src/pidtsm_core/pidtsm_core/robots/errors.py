"""Errors of robot descriptions."""

import re

_ELEMENT = re.compile(r"(link|joint) (.+?): ")


class DescriptionError(ValueError):
    """A description that cannot be used; a message about a link or joint begins with ``link NAME:`` or ``joint NAME:``.

    Attributes:
        element: kind (``link`` or ``joint``) and name; None if the message is about the whole description.
    """

    @property
    def element(self) -> tuple[str, str] | None:
        found = _ELEMENT.match(str(self))
        return (found[1], found[2]) if found else None
