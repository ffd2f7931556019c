"""The whole of `params.yaml`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from hdsafebo.params.base import Block, Count, Name
from hdsafebo.params.embeddings import Digits, Embeddings, IsometryParams
from hdsafebo.params.hand import Hand
from hdsafebo.params.methods import MethodBlock, with_algorithms
from hdsafebo.params.spinal import Spinal
from hdsafebo.params.tasks import InformedFamily, Tasks


class Compute(Block):
    """Where runs are computed.

    Attributes:
        workers: processes of the pool; null takes one per core.
        scheduler: address of a Dask scheduler; null uses the process pool.
    """

    workers: Count | None = None
    scheduler: str | None = None


class Tracking(Block):
    """The MLflow mirror of the results.

    Attributes:
        enabled: false logs nothing and imports nothing of MLflow.
    """

    enabled: bool = True


class ReportParams(Block):
    """How the report states uncertainty.

    Attributes:
        confidence: of bootstrap and binomial intervals.
        bootstrap_samples: per interval.
        calibration_bins: bins of the predicted safe probability.
        seed: of the bootstrap.
    """

    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    bootstrap_samples: Annotated[int, Field(ge=100)] = 4000
    calibration_bins: Annotated[int, Field(ge=2, le=50)] = 10
    seed: Annotated[int, Field(ge=0)] = 0


class Params(Block):
    """The whole of `params.yaml`.

    Attributes:
        profile: name of the size, for reports and costs; `hdsafebo profile` writes it.
        methods: what runs under each name; the other keys of a block are settings of its algorithm.
    """

    profile: Name
    spinal: Spinal = Spinal()
    hand: Hand = Hand()
    embeddings: Embeddings = Embeddings()
    isometry: IsometryParams = IsometryParams()
    digits: Digits = Digits()
    tasks: Tasks
    methods: dict[Name, MethodBlock]
    compute: Compute = Compute()
    tracking: Tracking = Tracking()
    report: ReportParams = ReportParams()

    @field_validator("methods", mode="before")
    @classmethod
    def _name_algorithms(cls, methods: Any) -> Any:
        return with_algorithms(methods)

    @model_validator(mode="after")
    def _one_threshold(self) -> Params:
        calibrated, used = self.spinal.safety_threshold, self.tasks.scs.problem.threshold
        if calibrated != used:
            raise ValueError(
                f"tasks.scs.problem.threshold is {used}, expected spinal.safety_threshold ({calibrated}), "
                "to which the dataset is calibrated"
            )
        return self

    @model_validator(mode="after")
    def _every_method_has_a_block(self) -> Params:
        for family, task in self.tasks:
            named: list[tuple[str, Iterable[str]]] = [("methods", task.methods), ("settings", task.settings)]
            if isinstance(task, InformedFamily):
                named.append(("informed.settings", task.informed.settings))
            for key, names in named:
                for name in names:
                    if name not in self.methods:
                        blocks = ", ".join(self.methods)
                        raise ValueError(
                            f"tasks.{family}.{key}: {name!r} has no block under methods, which has {blocks}"
                        )
                    if (space := self.methods[name].space) not in task.spaces:
                        raise ValueError(
                            f"tasks.{family}.{key}: {name!r} searches the space {space!r}; "
                            f"expected one of {', '.join(task.spaces)}"
                        )
        return self
