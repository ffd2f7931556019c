"""What is known of a task before the first trial: stated once per task, the same for every method."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class TaskKnowledge:
    """What a task gives to its methods, each in words for the report; None where a task gives nothing.

    A method takes what it can use (`Optimizer.uses` names these fields), and the report says what it leaves.

    Attributes:
        latent_space: the space that is searched in place of the inputs, and its box.
        kernel_features: what a kernel measures distances between, in place of the searched coordinates.
        candidate_rows: the finite set of inputs, and what a kernel sees of its rows.
        safety: the safety functions that a model is fitted to, and how they are transformed.
        extra_trials: what was evaluated before the initial trials.
    """

    latent_space: str | None = None
    kernel_features: str | None = None
    candidate_rows: str | None = None
    safety: str | None = None
    extra_trials: str | None = None

    def given(self) -> dict[str, str]:
        """What the task gives, by name."""
        return {name: text for name, text in asdict(self).items() if text is not None}

    def unused(self, uses: frozenset[str], *, original: bool) -> list[str]:
        """Names of what is given and not used.

        Args:
            uses: fields that the method can use.
            original: the method searches the inputs themselves.
        """
        used = uses - {"latent_space"} if original else uses
        return [name for name in self.given() if name not in used]
