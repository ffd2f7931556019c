"""Blocks of the spinal cord and the stimulation dataset."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from hdsafebo.params.base import Block, Count, Positive


class SpinalMesh(Block):
    """Resolution of the finite-element model, in mm.

    Attributes:
        cord: edge length in the cord's section.
        contacts: edge length at the contacts.
        largest: largest edge length anywhere in the section.
        step: distance of the slices along cord and paddle.
    """

    cord: Positive = 0.4
    contacts: Positive = 0.2
    largest: Positive = 4.0
    step: Positive = 0.5


class Spinal(Block):
    """Finite-element model of the cord and the traversal of the stimulation parameters.

    Attributes:
        mesh: resolution.
        tolerance: of the linear solver's relative residual.
        anatomy: dimensions in mm that replace those of `spinal/geometry/anatomy.py`, by name.
        conductivity: conductivities in S/m that replace those of `spinal/geometry/anatomy.py`, by tissue.
        districts: [first, last] segment of motor pools, in place of those of `spinal/geometry/anatomy.py`.
        sample_spacing: of the points in the section at which the activating function is taken, mm.
        sample_slices: heights at which the activating function is taken, from L1 to S2.
        currents: the ten currents of the dataset, mA, increasing.
        safety_threshold: least g of a safe row; the activation threshold is calibrated to it.
    """

    mesh: SpinalMesh = SpinalMesh()
    tolerance: Annotated[float, Field(gt=0, lt=1e-3)] = 1e-8
    anatomy: dict[str, float] = {}
    conductivity: dict[str, Positive] = {}
    districts: dict[str, Annotated[list[str], Field(min_length=2, max_length=2)]] = {}
    sample_spacing: Positive = 0.6
    sample_slices: Count = 72
    currents: Annotated[list[Positive], Field(min_length=10, max_length=10)] = [
        0.05, 0.0834, 0.139, 0.232, 0.387, 0.646, 1.08, 1.8, 3.0, 5.0,
    ]  # fmt: skip
    safety_threshold: Annotated[float, Field(ge=0, lt=1)] = 0.05

    @model_validator(mode="after")
    def _increasing(self) -> Spinal:
        if any(a >= b for a, b in zip(self.currents[:-1], self.currents[1:], strict=True)):
            raise ValueError(f"currents must increase, got {self.currents}")
        return self
