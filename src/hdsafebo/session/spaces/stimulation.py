"""The clinical problem: 16 contacts and a current; selectivity from EMG; safety from people's scores."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from hdsafebo.problem import Safety
from hdsafebo.session.definition import Definition, Scores, StimulationDefinition
from hdsafebo.session.errors import LimitError, RecordingError
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.emg import activation, samples_digest, selectivity
from hdsafebo.session.measuring.outcome_scale import LogScale
from hdsafebo.session.measuring.recordings import read_recording
from hdsafebo.session.measuring.stimulator import CONTACTS, Envelope, Polarity
from hdsafebo.session.measuring.tables import MeasuredTable
from hdsafebo.session.spaces.space import (
    MAX_INITIAL_TRIALS,
    TIME_COLUMN,
    Measured,
    Report,
    Space,
    check_keys,
    check_times,
    finite,
)
from hdsafebo.session.words import LONGEST_NAME, parse_number, trimmed_text
from hdsafebo.typing import FloatArray

SAFETY_NAME = "score"
_LEAST_SELECTIVITY = 0.02  # about that of a muscle at rest: of the noise between its pulses
CONTACT_COLUMNS = tuple(f"e{i}" for i in range(1, CONTACTS + 1))
CURRENT_COLUMN = "current_ma"
_POINT_HINT = "expected contacts 1 to 16, each once, and a current, such as 4- 12+ 13+ at 2.5 mA"
_STIMULATION = re.compile(r"(?P<contacts>.*?)((^|\s)at\s+(?P<current>\S+?)\s*(mA)?)?", re.DOTALL)
_CONTACT = re.compile(r"([0-9]{1,2})([+-])")
_FILE_HINT = "expected polarities -1, 0 or 1"


class StimulationSpace(Space):
    """See `Space`. A point is `{"polarity": [16 of -1, 0, 1], "current_ma": number}`."""

    takes_recordings = True
    scale = LogScale(_LEAST_SELECTIVITY)

    def __init__(self, definition: StimulationDefinition) -> None:
        self.emg, self.scores = definition.emg, definition.scores
        self.envelope = Envelope(definition.stimulator, definition.limits)
        self.targets = tuple(definition.emg.muscles)
        self._logit = _Logit(definition.scores)
        self.safety = (Safety(SAFETY_NAME, definition.scores.threshold, transform=self._logit),)
        self.inputs = (*CONTACT_COLUMNS, CURRENT_COLUMN)
        self.entries = tuple(definition.scores.raters)

    def tighten(self, definition: Definition) -> None:
        """Let the limits and the impedances of a definition hold; see `Space.tighten`."""
        assert isinstance(definition, StimulationDefinition)
        self.envelope.tighten(definition.stimulator, definition.limits)

    def point(self, data: Mapping[str, Any]) -> Point:
        """Polarities and current; see `Space.point`."""
        if set(data) != {"polarity", CURRENT_COLUMN}:
            raise LimitError(
                f"a stimulation has polarity and {CURRENT_COLUMN}, "
                f"got {', '.join(map(str, data)) or 'nothing'}"
            )
        given = data["polarity"]
        if not isinstance(given, list | tuple | np.ndarray) or len(given) != CONTACTS:
            raise LimitError(f"polarity: expected {CONTACTS} values, {_FILE_HINT}")
        values = [finite(v, f"polarity of contact {i}") for i, v in enumerate(given, start=1)]
        for contact, value in enumerate(values, start=1):
            if value not in (-1.0, 0.0, 1.0):
                raise LimitError(f"polarity of contact {contact} is {value:g}, {_FILE_HINT}")
        return {
            "polarity": [int(v) for v in values],
            CURRENT_COLUMN: finite(data[CURRENT_COLUMN], CURRENT_COLUMN),
        }

    def breaches(self, point: Point, last: Point | None) -> list[str]:
        """Hard limits exceeded; see `Space.breaches`."""
        polarity, current = arrays([point])
        return self.envelope.breaches(
            polarity[0], float(current[0]), None if last is None else last[CURRENT_COLUMN]
        )

    def describe(self, point: Point) -> str:
        """Such as `4- 12+ 13+ at 2.5 mA`."""
        signs = {-1: "-", 1: "+"}
        order = sorted((sign, contact) for contact, sign in enumerate(point["polarity"], start=1) if sign)
        contacts = " ".join(f"{contact}{signs[sign]}" for sign, contact in order)
        return f"{contacts or 'no contact'} at {point[CURRENT_COLUMN]:g} mA"

    def parse(self, text: str, base: Point | None) -> Point:
        """Contacts with their signs, `at`, a current; either half may be left out. See `Space.parse`."""
        match = _STIMULATION.fullmatch(text.strip())
        assert match is not None, "every text has these parts, the second one perhaps empty"
        words, current = match["contacts"].split(), match["current"]
        if base is None and not (words and current):
            raise LimitError(f"{text!r}: {_POINT_HINT}")
        polarity = [0] * CONTACTS if words or base is None else list(base["polarity"])
        for word in words:
            contact = _CONTACT.fullmatch(word)
            if contact is None or not 1 <= int(contact[1]) <= CONTACTS or polarity[int(contact[1]) - 1]:
                raise LimitError(f"{word!r}: {_POINT_HINT}")
            polarity[int(contact[1]) - 1] = 1 if contact[2] == "+" else -1
        value = parse_number(current) if current or base is None else base[CURRENT_COLUMN]
        if value is None:
            raise LimitError(f"current {current!r}: {_POINT_HINT}")
        return self.point({"polarity": polarity, CURRENT_COLUMN: value})

    def along(self, point: Point, count: int) -> dict[str, list[tuple[float, Point]]]:
        """Along the current; see `Space.along`."""
        highest = self.envelope.limits.max_current_ma
        currents = np.linspace(highest / count, highest, count).tolist()
        return {CURRENT_COLUMN: [(v, point | {CURRENT_COLUMN: v}) for v in currents]}

    def row(self, point: Point) -> dict[str, float]:
        """Columns e1 ... e16 and current_ma."""
        return dict(zip(self.inputs, [*point["polarity"], point[CURRENT_COLUMN]], strict=True))

    def shown_safety(self, name: str, modelled: float) -> float:
        """The score behind its logit; see `Space.shown_safety`."""
        return self._logit.inverse(modelled)

    def measure(self, report: Report, labels: Mapping[str, str]) -> Measured:
        """Selectivity of every muscle from the recording, safety = the lowest score; see `Space.measure`."""
        scores = self._scores(report.values)
        safety = {SAFETY_NAME: min(scores.values())}
        details: dict[str, Any] = {"scores": scores}
        if report.recording is None:
            return Measured(None, safety, details)
        content, name = report.recording
        recording = read_recording(content, name, self.emg)
        for key, value in recording.labels.items():
            if key in labels and value != labels[key]:
                raise RecordingError(f"{name}: says it is of {key} {value!r}, this is {key} {labels[key]!r}")
        mu = activation(recording, self.emg)
        details |= {
            "mu": mu.tolist(),
            "recording": {
                "name": trimmed_text(name, LONGEST_NAME, "recording"),
                "sha256": hashlib.sha256(content).hexdigest(),
                "samples_sha256": samples_digest(recording, self.emg),
            },
        }
        return Measured(self._outcomes(mu), safety, details)

    def check_result(self, result: Mapping[str, Any]) -> None:
        """See `Space.check_result`."""
        details = result["details"]
        scores = self._scores(details.get("scores", {}))
        if result["safety"] != {SAFETY_NAME: min(scores.values())}:
            raise RecordingError(f"{SAFETY_NAME} is not the lowest of the scores")
        if (result["outcomes"] is None) != (details.get("mu") is None):
            raise RecordingError(
                "outcomes without the amplitudes they follow from, or these without outcomes"
            )
        if result["outcomes"] is not None:
            expected = self._outcomes(np.array(details["mu"], float))
            if set(expected) != set(result["outcomes"]) or not all(
                np.isclose(result["outcomes"][name], value, rtol=1e-9, atol=0)
                for name, value in expected.items()
            ):
                raise RecordingError("outcomes do not follow from the amplitudes")

    def initial_trials(self, table: MeasuredTable) -> list[dict[str, Any]]:
        """Columns e1 ... e16, current_ma, mu_MUSCLE (empty: no recording), score_RATER, optionally time."""
        mu_columns = [f"mu_{m}" for m in self.targets]
        score_columns = [f"score_{r}" for r in self.entries]
        table.require([*self.inputs, *mu_columns, *score_columns], [TIME_COLUMN], MAX_INITIAL_TRIALS)
        times = check_times(table)
        return [
            self._initial(table, row, mu_columns, score_columns) | {"time": times[row]}
            for row in range(len(table))
        ]

    def _initial(
        self, table: MeasuredTable, row: int, mu_columns: list[str], score_columns: list[str]
    ) -> dict[str, Any]:
        try:
            point = self.point(
                {
                    "polarity": [table.needed(row, c) for c in CONTACT_COLUMNS],
                    CURRENT_COLUMN: table.needed(row, CURRENT_COLUMN),
                }
            )
            polarity, current = arrays([point])
            wrong = (
                [] if Envelope.well_formed(polarity, current)[0] else ["no cathode, no anode or no current"]
            )
            scores = self._scores(
                {r: table.needed(row, c) for r, c in zip(self.entries, score_columns, strict=True)}
            )
        except (LimitError, RecordingError) as error:
            text = str(error)
            raise RecordingError(
                text if text.startswith(table.source) else f"{table.at(row)}: {text}"
            ) from None
        if wrong:
            raise RecordingError(f"{table.at(row)}: {wrong[0]}")
        mu = [table.number(row, c) for c in mu_columns]
        details: dict[str, Any] = {"scores": scores}
        outcomes = None
        if all(m is not None for m in mu):
            values = np.array(mu, float)
            if (values < 0).any():
                raise RecordingError(f"{table.at(row)}: mu is negative, expected 0 or more")
            outcomes = self._outcomes(values)
            details["mu"] = values.tolist()
        elif any(m is not None for m in mu):
            raise RecordingError(
                f"{table.at(row)}: some of {', '.join(mu_columns)} are empty, expected all or none"
            )
        return {
            "point": point,
            "outcomes": outcomes,
            "safety": {SAFETY_NAME: min(scores.values())},
            "details": details,
        }

    def _outcomes(self, mu: FloatArray) -> dict[str, float]:
        if len(mu) != len(self.targets):
            raise RecordingError(f"{len(mu)} amplitudes, expected one of each of {len(self.targets)} muscles")
        return dict(zip(self.targets, selectivity(mu).tolist(), strict=True))

    def _scores(self, values: Mapping[str, float]) -> dict[str, float]:
        check_keys(values, self.entries, "scores of")
        scale = self.scores
        scores = {}
        for rater in self.entries:
            try:
                score = finite(values[rater], f"score of {rater}")
            except LimitError as error:
                raise RecordingError(str(error)) from None
            if not scale.minimum <= score <= scale.maximum:
                raise RecordingError(
                    f"score of {rater} is {score:g}, expected {scale.minimum:g} to {scale.maximum:g}"
                )
            scores[rater] = score
        return scores


class _Logit:
    """Scores pile up at the ends of their scale; their logit is closer to a Gaussian process.

    log((score - minimum + margin) / (maximum - score + margin)), with a margin of a twentieth of the scale.
    """

    def __init__(self, scores: Scores) -> None:
        self._margin = (scores.maximum - scores.minimum) / 20.0
        self._low, self._high = scores.minimum, scores.maximum

    def __call__(self, score: FloatArray) -> FloatArray:
        value = np.asarray(score, float)
        return np.asarray(np.log((value - self._low + self._margin) / (self._high - value + self._margin)))

    def inverse(self, logit: float) -> float:
        """The score of a logit, within the scale."""
        share = 1.0 / (1.0 + np.exp(-logit))
        low, high = self._low - self._margin, self._high + self._margin
        return float(np.clip(low + share * (high - low), self._low, self._high))


def arrays(points: list[Point]) -> tuple[Polarity, FloatArray]:
    """Polarities (n, 16) and currents (n,) of points."""
    polarity = np.array([p["polarity"] for p in points], np.int8).reshape(-1, CONTACTS)
    return polarity, np.array([p[CURRENT_COLUMN] for p in points], float)
