"""Block of a method: what runs under a name, in which space, with which settings."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import ConfigDict

from hdsafebo.params.base import Block, MethodSettings, Scalar

Space = Literal["latent", "original", "torques", "gains"]
"""What is searched; `torques` and `gains` exist on the body alone."""


class MethodBlock(Block):
    """A method under the name of its block, which tasks list, DVC makes an item and run files carry.

    Everything beside the two attributes is a setting of the algorithm: `{space: original, beta: -2.0}`.

    Attributes:
        algorithm: what runs, by its name in the registry of methods; the name of the block unless given.
        space: what is searched: the codes of the task's embedding, or the problem's own inputs; on the body
            also its weights over joint-torque synergies, or the gains of a reflex.
    """

    model_config = ConfigDict(extra="allow")

    algorithm: str
    space: Space = "latent"
    __pydantic_extra__: dict[str, Scalar | dict[str, Scalar]]

    @property
    def settings(self) -> MethodSettings:
        """Settings by name."""
        return dict(self.__pydantic_extra__)


def with_algorithms(methods: Any) -> Any:
    """Blocks of methods as they were read; where a block gives no algorithm, its name is the algorithm."""
    if not isinstance(methods, dict):
        return methods
    return {
        name: {"algorithm": name} | block if isinstance(block, dict) else block
        for name, block in methods.items()
    }
