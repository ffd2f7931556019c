"""What can be wrong with a description or with a table."""

from __future__ import annotations

from hdsafebo.errors import HdSafeBOError


class DescriptionError(HdSafeBOError):
    """A description of a system is incomplete or contradicts itself; the message names part and value."""


class TableError(HdSafeBOError):
    """A table or record does not fit the system: a name, a value or a row, which the message gives."""


class StudyError(HdSafeBOError):
    """A stored study is missing, damaged, or belongs to another system or method."""
