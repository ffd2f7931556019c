"""Typed exceptions: every message names the thing, the value it had and what was expected."""

from __future__ import annotations


class HdSafeBOError(Exception):
    """Base of every error that this package raises on purpose."""


class ParamsError(HdSafeBOError):
    """A key of `params.yaml` is unknown, of the wrong type or out of range."""


class ProblemError(HdSafeBOError):
    """A problem is ill-posed: an empty box, no safety function, a threshold that is no number."""


class TrialError(HdSafeBOError):
    """A result that cannot be taken in: wrong shape, not finite, an unknown or a conflicting trial."""


class NoSafePointError(HdSafeBOError):
    """Nothing is known or believed to be safe, so the optimiser abstains."""


class OptimisticWarning(UserWarning):
    """A method promises its trials less than an even chance of being safe, by a default that nobody set."""


class SurrogateError(HdSafeBOError):
    """A Gaussian process could not be fitted, not even with the last good hyper-parameters."""


class StateFileError(HdSafeBOError):
    """A saved state is missing, damaged, or belongs to another problem or method."""


class EmbeddingFileError(HdSafeBOError):
    """An embedding file is damaged, hostile or of another shape than its use needs."""


class EmbeddingTrainingError(HdSafeBOError):
    """A learned embedding collapsed or diverged."""


class IsometryError(HdSafeBOError):
    """An embedding preserves distances less well than its floor demands."""


class AnatomyError(HdSafeBOError):
    """The spinal anatomy is impossible, or a contact lies off the paddle."""


class DatasetError(HdSafeBOError):
    """A table has missing or extra rows or columns, or values outside their range."""


class HandModelError(HdSafeBOError):
    """The musculoskeletal model, its start pose, its synergies or a policy do not fit each other."""


class PolicyFileError(HdSafeBOError):
    """A policy file is missing or damaged, or belongs to another environment or problem."""


class RenderingUnavailableError(HdSafeBOError):
    """No OpenGL renderer is on this machine; the message says what to install."""


class JournalError(HdSafeBOError):
    """The journal of a run is damaged, or its disk cannot be written."""


class UnknownNameError(HdSafeBOError):
    """A registry has no entry of that name; the message lists the valid ones."""

    def __init__(self, kind: str, name: str, valid: list[str] | tuple[str, ...]) -> None:
        super().__init__(f"unknown {kind} {name!r}; valid names: {', '.join(sorted(valid))}")
