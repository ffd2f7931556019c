"""`params.yaml` as frozen models: every key typed, every range checked, every error named."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from hdsafebo.errors import ParamsError

Scalar = bool | int | float | str | None
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Block(BaseModel):
    """A block of `params.yaml`: immutable, no unknown keys, no silent conversions."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


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
        anatomy: dimensions in mm that replace those of `spinal/anatomy.py`, by name.
        conductivity: conductivities in S/m that replace those of `spinal/anatomy.py`, by tissue.
        districts: [first, last] segment of motor pools, replacing those of `spinal/anatomy.py`, by muscle.
        sample_spacing: of the points in the section at which the activating function is taken, mm.
        sample_slices: heights at which it is taken, from L1 to S2.
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


class HandScene(Block):
    """Model and episode.

    Attributes:
        variant: forearm (43 muscles, 23 joints) or extended (55 muscles, 28 joints, as in the paper).
        roll: rotation of the fixed upper arm, rad; it sets how far the forearm must pronate.
        horizon: control steps of 20 ms per episode.
    """

    variant: Literal["forearm", "extended"] = "extended"
    roll: Annotated[float, Field(ge=0, le=1.57)] = 1.4
    horizon: Count = 120


class HandSac(Block):
    """Training of the agents whose activations carry the synergies.

    Attributes:
        settings: observation settings; one agent each.
        steps: control steps per agent.
        width: units of each of the two hidden layers.
        train_every: control steps between updates.
        updates: gradient steps per update.
        seed: of all agents.
    """

    settings: Annotated[list[Literal["full", "posture", "bottle", "touch"]], Field(min_length=1)] = [
        "full",
        "bottle",
    ]
    steps: Annotated[int, Field(ge=600)] = 20_000
    width: Count = 128
    train_every: Count = 4
    updates: Count = 2
    seed: Annotated[int, Field(ge=0)] = 0


class HandRollouts(Block):
    """Episodes of all checkpoints of all agents, with exploration.

    Attributes:
        episodes: number of episodes.
        seed: of the exploration.
    """

    episodes: Annotated[int, Field(ge=2)] = 200
    seed: Annotated[int, Field(ge=0)] = 0


class HandSynergies(Block):
    """Components of the activations, and what random policies over them do.

    Attributes:
        count: synergies of the latent space.
        box: limit of the size of each weight of a policy over synergies.
        landing_limit: landing speed up to which a policy counts as safe, m/s (paper, appendix).
        random_policies: policies drawn from the box that show how hard the task is.
        reference_policies: those of them whose observations give the kernel its metric.
        seed: of the random policies.
    """

    count: Annotated[int, Field(ge=1, le=10)] = 5
    box: Positive = 1.0
    landing_limit: Positive = 4.4
    random_policies: Annotated[int, Field(ge=2)] = 200
    reference_policies: Annotated[int, Field(ge=2)] = 50
    seed: Annotated[int, Field(ge=0)] = 0


class Hand(Block):
    """Musculoskeletal hand: model, environment, rollouts and synergies."""

    scene: HandScene = HandScene()
    sac: HandSac = HandSac()
    rollouts: HandRollouts = HandRollouts()
    synergies: HandSynergies = HandSynergies()


class Embeddings(Block):
    """Embeddings of the stimulation field maps.

    Attributes:
        models: settings by name of the embeddings that are trained (`embeddings/`).
        held_out_share: share of the configurations that no training sees.
        seed: of the split and of all training.
    """

    models: dict[str, dict[str, Scalar]] = {
        "irvae": {},
        "pca": {},
        "random": {},
        "residual": {"homogeneous": True, "origin": 1.0},
        "vae": {},
    }
    held_out_share: Annotated[float, Field(gt=0, lt=1)] = 0.1
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _settings_known(self) -> Embeddings:
        from hdsafebo.embeddings.registry import embedding_class
        from hdsafebo.errors import UnknownNameError

        for name, settings in self.models.items():
            try:
                embedding_class(name).check_settings(settings)
            except (ParamsError, UnknownNameError) as error:
                raise ValueError(f"models: {error}") from None
        return self


class IsometryFloors(Block):
    """Least values of an embedding's measures (`embeddings/isometry.py`); null demands nothing."""

    distance_correlation: Share | None = None
    round_trip: Share | None = None
    round_trip_held_out: Share | None = None
    round_trip_held_out_currents: Share | None = None


class Isometry(Block):
    """The check that runs before anything is optimised over an embedding.

    Attributes:
        points: field maps between which distances are taken; the paper has 10,000.
        pairs: random pairs of them.
        figure_pairs: pairs that are kept for the scatter figure.
        gp_points: maps of the Gaussian process comparison; half of them are observed.
        gp_draws: functions that are drawn for it.
        jacobian_points: codes at which the pullback metric is taken.
        round_trip_rows: rows of the dataset of which each round-trip share is taken.
        seed: of all that is drawn.
        floors: least value of measures, by embedding; below it the pipeline stops.
    """

    points: Annotated[int, Field(ge=100)] = 10_000
    pairs: Annotated[int, Field(ge=100)] = 200_000
    figure_pairs: Count = 5_000
    gp_points: Annotated[int, Field(ge=10)] = 1_000
    gp_draws: Count = 32
    jacobian_points: Count = 100
    round_trip_rows: Count = 5_000
    seed: Annotated[int, Field(ge=0)] = 0
    floors: dict[str, IsometryFloors] = {}


class Digits(Block):
    """Images, predictor and embedding of the digits task.

    Attributes:
        source: `sklearn` (bundled 8 x 8 images), `idx` (MNIST's files in `folder`) or `openml` (a download).
        folder: directory of the IDX files, relative to the project's.
        predictor_epochs: passes over the images when the predictor is trained.
        embedding: name of the embedding.
        embedding_settings: its settings (`embeddings/`).
        seed: of all that is trained.
    """

    source: Literal["sklearn", "idx", "openml"] = "sklearn"
    folder: str | None = None
    predictor_epochs: Count = 40
    embedding: str = "irvae"
    embedding_settings: dict[str, Scalar] = {"latent_dim": 6}
    seed: Annotated[int, Field(ge=0)] = 0

    def folder_path(self, root: Path) -> Path | None:
        """Directory of the IDX files."""
        return None if self.folder is None else root / self.folder


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


class SyntheticProblem(Block):
    """Objective and safety drawn from Gaussian processes (paper, section 5.1 and appendix)."""

    dimension: Count = 1000
    latent_dimension: Count = 50
    effective_dimension: Count = 40
    length_scale: Positive = 0.05
    threshold: float = -0.75
    noise_variance: Annotated[float, Field(ge=0)] = 1e-4
    with_replacement: bool = False

    @model_validator(mode="after")
    def _nested(self) -> SyntheticProblem:
        if not self.effective_dimension <= self.latent_dimension <= self.dimension:
            raise ValueError(
                "expected effective_dimension <= latent_dimension <= dimension, got "
                f"{self.effective_dimension}, {self.latent_dimension}, {self.dimension}"
            )
        return self


class SyntheticTask(Block):
    """The synthetic task and the methods that run on it."""

    problem: SyntheticProblem = SyntheticProblem()
    budget: Budget
    methods: list[str]


HandSafety = Literal["landing_speed", "no_drop", "handling_speed"]


class HandProblem(Block):
    """What the optimisers see of the hand (`problems/hand.py` defines the safety functions).

    Attributes:
        handling_limit: of `handling_speed`, m/s.
        reported: safety functions that decide whether a trial was safe.
        modelled: safety functions that the methods model.
        modelled_local: those that hdsafebo_local and its variants model.
        directions: directions of observations in the kernel of hdsafebo_local.
    """

    handling_limit: Positive = 1.0
    reported: Annotated[list[HandSafety], Field(min_length=1)] = ["landing_speed"]
    modelled: Annotated[list[HandSafety], Field(min_length=1)] = ["landing_speed"]
    modelled_local: Annotated[list[HandSafety], Field(min_length=1)] = ["no_drop"]
    directions: Count = 4


class HandTask(Block):
    """The hand task and the methods that run on it."""

    problem: HandProblem = HandProblem()
    budget: Budget
    methods: list[str]


class ScsProblem(Block):
    """What the optimisers see of the stimulation dataset.

    Attributes:
        embedding: latent space of the methods that search one.
        threshold: least safe value of g = 1 - max_i mu_i (paper, appendix).
        side: of the target muscle.
    """

    embedding: str = "irvae"
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.05
    side: Literal["left", "right"] = "left"


class ScsTask(Block):
    """The stimulation tasks, one per target muscle (`scs_st`, `scs_ga`, ...)."""

    problem: ScsProblem = ScsProblem()
    budget: Budget
    tasks: list[Literal["scs_il", "scs_vlrf", "scs_ta", "scs_bfgm", "scs_st", "scs_ga"]]
    methods: list[str]


class DigitsProblem(Block):
    """What makes an image valid.

    Attributes:
        temperature: of the predictor's softmax; 2 on the 8 x 8 images gives the confidence profile that
            the paper's network has at 200.
        threshold: least probability of a valid image.
    """

    temperature: Positive = 2.0
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5


class DigitsTask(Block):
    """The ten tasks `digits_0` ... `digits_9` and the methods that run on them."""

    problem: DigitsProblem = DigitsProblem()
    budget: Budget
    tasks: list[Annotated[str, Field(pattern=r"^digits_[0-9]$")]]
    methods: list[str]


class Tasks(Block):
    """One block per family of tasks."""

    synthetic: SyntheticTask
    hand: HandTask
    scs: ScsTask
    digits: DigitsTask


class Compute(Block):
    """Where runs are computed.

    Attributes:
        workers: processes of the pool; null takes one per core.
        scheduler: address of a Dask scheduler; null uses the process pool.
    """

    workers: Count | None = None
    scheduler: str | None = None


class Tracking(Block):
    """The MLflow mirror of the results."""

    enabled: bool = True


class Report(Block):
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
    """The whole of `params.yaml`."""

    profile: str
    spinal: Spinal = Spinal()
    hand: Hand = Hand()
    embeddings: Embeddings = Embeddings()
    isometry: Isometry = Isometry()
    digits: Digits = Digits()
    tasks: Tasks
    methods: dict[str, dict[str, Scalar]]
    compute: Compute = Compute()
    tracking: Tracking = Tracking()
    report: Report = Report()

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
    def _methods_known(self) -> Params:
        from hdsafebo.optimizers.registry import method_names

        known = method_names()
        for name in self.methods:
            if name not in known:
                raise ValueError(f"methods: unknown method {name!r}; valid names: {', '.join(sorted(known))}")
        for family, task in self.tasks:
            for name in task.methods:
                if name not in self.methods:
                    blocks = ", ".join(self.methods)
                    raise ValueError(
                        f"tasks.{family}.methods: {name!r} has no block under methods, which has {blocks}"
                    )
        return self


def load_params(path: Path) -> Params:
    """Read and check a parameter file.

    Args:
        path: a YAML file; only plain data is constructed from it.

    Raises:
        ParamsError: the file is missing, is no YAML mapping, or a key is unknown, of the wrong type
            or out of range. The message names file, key, value and what was expected.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ParamsError(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError, ValueError, yaml.YAMLError, RecursionError) as error:
        raise ParamsError(f"{path}: cannot be read as YAML: {' '.join(str(error).split())}") from error
    if not isinstance(data, dict):
        raise ParamsError(f"{path}: expected a mapping of blocks, got {type(data).__name__}")
    return parse_params(data, source=str(path))


def parse_params(data: dict[str, Any], *, source: str = "params") -> Params:
    """Check parameters that were already read; see `load_params`."""
    try:
        return Params.model_validate(data)
    except ValidationError as error:
        raise ParamsError("\n".join(f"{source}: {_explain(e)}" for e in error.errors())) from None


def _explain(error: Any) -> str:
    """One line of a pydantic error: key, what is wrong, the value."""
    key = ".".join(str(part) for part in error["loc"]) or "(top level)"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        return f"{key}: unknown key (value {_short(error['input'])}); {_valid_keys(error['loc'])}"
    if error["type"] in ("missing", "value_error"):
        return f"{key}: {message}"
    return f"{key}: {message}, got {_short(error['input'])}"


def _valid_keys(location: tuple[Any, ...]) -> str:
    """The keys that the block at `location[:-1]` has."""
    block: Any = Params
    for part in location[:-1]:
        field = getattr(block, "model_fields", {}).get(part)
        block = field.annotation if field is not None else None
    names = sorted(getattr(block, "model_fields", {}))
    return f"valid keys: {', '.join(names)}" if names else "remove it"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
