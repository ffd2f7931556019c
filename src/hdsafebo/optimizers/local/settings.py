"""Settings of the local method: those of all methods, and a block for each part that can be set."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from hdsafebo.optimizers.settings import SafeSetSettings


class RestartSettings(BaseModel):
    """Of climbs by single trials through an embedding or features.

    Attributes:
        beta: of the safe set in which the next climb begins; None takes the method's. A larger one finds more
            optima; first trials that the method's beta alone would have refused are marked.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    beta: float | None = None


class HdSafeBOLocalSettings(SafeSetSettings):
    """Settings of the local method.

    Attributes:
        beta: of the safe set; -2 promises a safe probability of 0.977.
        restarts: of single trials through an embedding or features; other problems refuse it.
    """

    beta: float = -2.0
    restarts: RestartSettings | None = None
