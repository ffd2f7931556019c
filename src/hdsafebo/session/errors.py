"""Errors of a session; each message names the file, line, channel or key, its value and what was expected."""

from __future__ import annotations

from hdsafebo.errors import HdSafeBOError


class SessionError(HdSafeBOError):
    """A command that does not fit the session, or a session directory that is no such thing."""


class DefinitionError(SessionError):
    """The session file is incomplete, has unknown keys, or values out of range."""


class LimitError(SessionError):
    """A stimulation or an input lies outside the hard limits."""


class RecordingError(SessionError):
    """A recording, a score or a table of trials is malformed."""


class ProtocolError(SessionError):
    """A step that the protocol does not allow now: the session is stopped, a decision was made before, ..."""


class StoppedError(ProtocolError):
    """The session was stopped, so the trial must not be delivered."""


class ExpiredError(ProtocolError):
    """The suggestion was computed from a state that is gone."""


class AuditError(SessionError):
    """The log was changed, cut or mixed with another session's."""
