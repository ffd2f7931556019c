"""A simulated patient: the spinal model's response, seen through noisy recordings and people's scores.

For trying the software out and for testing it; no claim about any real patient. Each constant below is an
assumption of the simulation.

    mu of a trial     = model's mu * day's gain of the muscle * trial's gain of the muscle
    recording         = one biphasic response per pulse with that peak-to-peak value, artefact, noise
    comfort           = 10 s / (s + s_0), s = 1 - mu of the most activated muscle of the model; 5 at s_0
    score of a rater  = comfort + the day's shift + the rater's noise, rounded to the scale
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.emg import Emg
from hdsafebo.session.measuring.stimulator import Polarity
from hdsafebo.session.patient.responses import MUSCLES, Responses
from hdsafebo.typing import FloatArray

RATERS = ("patient", "therapist")
SCALE = 10.0
_COMFORT_HALF = 0.05  # s_0: share that the strongest muscle leaves at comfort 5 (the paper's h on g)
_COMFORT_SPREAD = 0.2  # sd of log s_0 between patients
_PATIENT_GAIN_SD, _DAY_GAIN_SD, _TRIAL_GAIN_SD = 0.15, 0.08, 0.05  # of log gains
_DAY_SHIFT_SD = 0.3  # of scores
_RATER_SD = {"patient": 0.4, "therapist": 0.3}
_THERAPIST_BIAS = 0.5  # the therapist sees less than the patient feels
_MISSING_SHARE = 0.02  # of recordings
_NOISE_UV, _PULSE_SD = 4.0, 0.03
_ARTEFACT_UV, _ARTEFACT_S = 300.0, 0.002
_LATENCY_S, _WIDTH_S = 0.012, 0.003


@dataclass(frozen=True)
class Response:
    """What the simulated patient gives back.

    Attributes:
        recording: content of a CSV recording; None when it went missing.
        scores: of each rater.
    """

    recording: bytes | None
    scores: dict[str, float]


class SimulatedPatient:
    """See the module. The same seed is the same patient; a trial's noise depends on seed and number only.

    Args:
        responses: the spinal model's table.
        emg: how recordings are made; its muscles are those of `responses.MUSCLES`.
        seed: of the patient.
    """

    def __init__(self, responses: Responses, emg: Emg, seed: int) -> None:
        self._responses = responses
        self._emg = emg
        self._seed = seed
        rng = self._rng(0)
        self._gain = np.exp(_PATIENT_GAIN_SD * rng.standard_normal(len(MUSCLES)))
        self._half = _COMFORT_HALF * float(np.exp(_COMFORT_SPREAD * rng.standard_normal()))

    def activation(self, point: Point) -> FloatArray:
        """mu (8,) without noise and drift: the truth about a stimulation."""
        return self._responses.at(point)[0] * self._gain

    def comfort(self, point: Point) -> float:
        """Comfort without noise and drift."""
        slack = 1.0 - self._responses.at(point)[1]
        return SCALE * slack / (slack + self._half)

    def truth(self, polarity: Polarity, currents_ma: FloatArray) -> tuple[FloatArray, FloatArray]:
        """True mu (n, K, 8) and comfort (n, K) of configurations (n, 16) at K currents each."""
        mu, strongest = self._responses.table(polarity, currents_ma)
        slack = 1.0 - strongest
        return mu * self._gain, SCALE * slack / (slack + self._half)

    def respond(self, point: Point, trial: int, day: int, labels: dict[str, str]) -> Response:
        """The response to a trial.

        Args:
            point: the stimulation.
            trial: its number.
            day: of the protocol; gains and scores drift from day to day.
            labels: written into the recording (`session`, `trial`).
        """
        daily, rng = self._rng(1, day), self._rng(2, trial)
        gain = np.exp(_DAY_GAIN_SD * daily.standard_normal(len(MUSCLES)))
        shift = _DAY_SHIFT_SD * daily.standard_normal()
        mu = self.activation(point) * gain * np.exp(_TRIAL_GAIN_SD * rng.standard_normal(len(MUSCLES)))
        felt = self.comfort(point) + shift
        scores = {
            rater: float(np.clip(round(felt + bias + _RATER_SD[rater] * rng.standard_normal()), 0, SCALE))
            for rater, bias in zip(RATERS, (0.0, _THERAPIST_BIAS), strict=True)
        }
        missing = rng.random() < _MISSING_SHARE
        recording = None if missing else self._record(mu, rng, labels)
        return Response(recording, scores)

    def _record(self, mu: FloatArray, rng: np.random.Generator, labels: dict[str, str]) -> bytes:
        """A CSV recording whose responses have the peak-to-peak values mu * reference."""
        emg = self._emg
        order = [MUSCLES.index(m) for m in emg.muscles]
        size_uv = mu[order] * np.array([emg.reference_uv[m] for m in emg.muscles])
        pulses = emg.clock_pulses()
        seconds = emg.windows(pulses, 0.0, emg.rate_hz)[-1][1] / emg.rate_hz + 0.02
        time = np.arange(int(seconds * emg.rate_hz)) / emg.rate_hz
        signal = _NOISE_UV * rng.standard_normal((len(time), len(size_uv)))
        for pulse in pulses:
            after = time - pulse
            size = size_uv * (1.0 + _PULSE_SD * rng.standard_normal(len(size_uv)))
            signal += _response(after)[:, None] * size
            signal[(after >= 0) & (after < _ARTEFACT_S)] += _ARTEFACT_UV
        header = "".join(f"# {key}: {value}\n" for key, value in labels.items())
        rows = "\n".join(
            f"{t:.4f}," + ",".join(f"{v:.1f}" for v in row)
            for t, row in zip(time.tolist(), signal.tolist(), strict=True)
        )
        return f"{header}time_s,{','.join(emg.muscles)}\n{rows}\n".encode()

    def _rng(self, *path: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, *path])


def _response(after_s: FloatArray) -> FloatArray:
    """Biphasic response, the derivative of a Gaussian scaled to a peak-to-peak value of 1."""
    t = (after_s - _LATENCY_S) / _WIDTH_S
    return np.asarray(-t * np.exp(0.5 * (1.0 - t * t)) / 2.0)
