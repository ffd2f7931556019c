"""Blocks of the tasks: the problem, how much is evaluated, which methods run."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from hdsafebo.params.base import Block, Count, MethodSettings, Positive
from hdsafebo.params.methods import Space

_CONTROL_INTERVAL = 0.01  # s, of `bodies.simulation`


class Budget(Block):
    """How much is evaluated in each run of a task.

    Attributes:
        initial: trials drawn before the optimiser starts.
        trials: all trials, the initial ones included.
        batch: trials per round.
        seeds: independent runs per method.
        first_seed: the runs use the seeds first_seed, first_seed + 1, ...
        seeds_of: methods that get another number of runs.
    """

    initial: Count
    trials: Count
    batch: Count
    seeds: Count
    first_seed: Annotated[int, Field(ge=0)] = 1000
    seeds_of: dict[str, Count] = {}

    @model_validator(mode="after")
    def _consistent(self) -> Budget:
        if self.trials <= self.initial:
            raise ValueError(f"trials ({self.trials}) must exceed initial ({self.initial})")
        return self

    def seeds_for(self, method: str) -> range:
        """Seeds of the runs of a method."""
        return range(self.first_seed, self.first_seed + self.seeds_of.get(method, self.seeds))


class Family(Block):
    """What every family of tasks has.

    Attributes:
        budget: how much is evaluated.
        methods: which run.
        settings: of methods on these tasks, beyond their settings on all tasks.
        spaces: what methods can search.
    """

    spaces: ClassVar[tuple[Space, ...]] = ("latent", "original")
    budget: Budget
    methods: list[str]
    settings: dict[str, MethodSettings] = {}

    def searched(self, space: Space) -> Space:
        """What a method of that space searches in fact."""
        return space

    def settings_for(self, method: str, *, informed: bool) -> MethodSettings:
        """Settings of a method on these tasks, in the paper's setting or the informed one."""
        return self.settings.get(method, {})


class Informed(Block):
    """What differs in the informed setting of a family.

    Attributes:
        settings: of methods in that setting, beyond those on all tasks of the family.
    """

    settings: dict[str, MethodSettings] = {}


class InformedFamily(Family):
    """A family whose informed setting has parameters of its own.

    Attributes:
        informed: these.
    """

    informed: Informed = Informed()

    def settings_for(self, method: str, *, informed: bool) -> MethodSettings:
        """As in all families, and those of the informed setting."""
        own = self.informed.settings.get(method, {}) if informed else {}
        return super().settings_for(method, informed=informed) | own


class SyntheticParams(Block):
    """Objective and safety drawn from Gaussian processes (paper, section 5.1 and appendix).

    Attributes:
        dimension: of the inputs.
        latent_dimension: of the codes, a random linear projection of the inputs.
        effective_dimension: codes that the functions depend on.
        length_scale: of both processes, in units of the codes.
        threshold: least safe value.
        noise_variance: of each observation.
        with_replacement: draw the effective codes with replacement, as the authors' program does.
    """

    dimension: Count = 1000
    latent_dimension: Count = 50
    effective_dimension: Count = 40
    length_scale: Positive = 0.05
    threshold: float = -0.75
    noise_variance: Annotated[float, Field(ge=0)] = 1e-4
    with_replacement: bool = False

    @model_validator(mode="after")
    def _nested(self) -> SyntheticParams:
        if not self.effective_dimension <= self.latent_dimension <= self.dimension:
            raise ValueError(
                "expected effective_dimension <= latent_dimension <= dimension, got "
                f"{self.effective_dimension}, {self.latent_dimension}, {self.dimension}"
            )
        return self


class SyntheticTask(Family):
    """The synthetic task and the methods that run on it.

    Attributes:
        problem: what is optimised.
    """

    problem: SyntheticParams = SyntheticParams()


HandSafety = Literal["landing_speed", "no_drop", "handling_speed"]


class HandProblem(Block):
    """What the optimisers see of the hand (`problems/hand.py` defines the safety functions).

    Attributes:
        handling_limit: of `handling_speed`, m/s.
        reported: safety functions that decide whether a trial was safe.
        modelled: safety functions that the methods model in the paper's setting.
    """

    handling_limit: Positive = 1.0
    reported: Annotated[list[HandSafety], Field(min_length=1)] = ["landing_speed"]
    modelled: Annotated[list[HandSafety], Field(min_length=1)] = ["landing_speed"]


class HandInformed(Informed):
    """What differs in the informed setting of the hand.

    Attributes:
        modelled: safety functions that the methods model.
        directions: directions of observations in the kernel.
    """

    modelled: Annotated[list[HandSafety], Field(min_length=1)] = ["no_drop"]
    directions: Count = 12


class HandTask(InformedFamily):
    """The hand in the paper's setting and in the informed one, and the methods that run in both.

    Attributes:
        problem: what the methods see.
        informed: what differs in the informed setting.
        tasks: which of the two settings run.
    """

    problem: HandProblem = HandProblem()
    informed: HandInformed = HandInformed()
    tasks: Annotated[list[Literal["hand", "hand_informed"]], Field(min_length=1)] = ["hand", "hand_informed"]


class BodyProblem(Block):
    """The whole body after a push (`problems/body.py`).

    Attributes:
        body: its model, 416 or 80 muscles.
        pushes: seeds of the pushes that every trial meets.
        unseen_pushes: seeds of pushes that no trial meets, for the best policies alone.
        horizon: control steps of 10 ms of an episode.
        least_time: that the body must stay up, s.
        most_load: torque of joint stops and couplings, over 0.1 s, that it must stay below, N m.
    """

    body: Literal["myofullbody", "myolegs"] = "myofullbody"
    pushes: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] = [1, 4, 9]
    unseen_pushes: list[Annotated[int, Field(ge=0)]] = [101, 102, 103, 104, 105]
    horizon: Count = 500
    least_time: Positive = 1.4
    most_load: Positive = 60.0

    @model_validator(mode="after")
    def _consistent(self) -> BodyProblem:
        if self.least_time > self.horizon * _CONTROL_INTERVAL:
            raise ValueError(
                f"least_time ({self.least_time:g} s) must not exceed the horizon "
                f"({self.horizon * _CONTROL_INTERVAL:g} s)"
            )
        if both := sorted(set(self.pushes) & set(self.unseen_pushes)):
            raise ValueError(f"pushes {both} are among pushes and unseen_pushes")
        return self


class BodyTask(Family):
    """The body, and the methods that run on it: over all weights, joint-torque synergies or reflex gains."""

    spaces: ClassVar[tuple[Space, ...]] = ("latent", "original", "torques", "gains")
    problem: BodyProblem = BodyProblem()

    def searched(self, space: Space) -> Space:
        """The body has no embedding: its latent space is its original one."""
        return "original" if space == "latent" else space


class ScsProblem(Block):
    """What the optimisers see of the stimulation dataset.

    Attributes:
        embedding: gives the latent space.
        threshold: least safe value of g = 1 - max_i mu_i (paper, appendix).
        side: of the target muscle.
    """

    embedding: str = "irvae"
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.05
    side: Literal["left", "right"] = "left"


class ScsInformed(Informed):
    """What differs in the informed setting of the stimulation tasks.

    Attributes:
        components: principal components of the responses of axons that the latent space has.
    """

    components: Annotated[int, Field(ge=1, le=84)] = 16


class ScsTask(InformedFamily):
    """The stimulation tasks, one per target muscle and setting (`scs_st`, `scs_st_informed`, ...).

    Attributes:
        problem: what the methods see.
        informed: what differs in the informed setting.
        tasks: which run: `scs_` and il, vlrf, ta, bfgm, st or ga, with or without `_informed`.
    """

    problem: ScsProblem = ScsProblem()
    informed: ScsInformed = ScsInformed()
    tasks: list[Annotated[str, Field(pattern=r"^scs_(il|vlrf|ta|bfgm|st|ga)(_informed)?$")]]


class DigitsProblem(Block):
    """What makes an image valid.

    Attributes:
        temperature: of the predictor's softmax, 200 in the paper; `problems/digit_predictor.py` says on which
            scale its outputs are.
        threshold: least probability of a valid image.
    """

    temperature: Positive = 200.0
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5


class DigitsTask(Family):
    """The tasks `digits_0` ... `digits_9` in both settings (`digits_0_informed`), and their methods.

    Attributes:
        problem: what makes an image valid.
        tasks: which run, such as `digits_3` or `digits_3_informed`.
    """

    problem: DigitsProblem = DigitsProblem()
    tasks: list[Annotated[str, Field(pattern=r"^digits_[0-9](_informed)?$")]]


class Tasks(Block):
    """One block per family of tasks."""

    synthetic: SyntheticTask
    hand: HandTask
    body: BodyTask
    scs: ScsTask
    digits: DigitsTask
