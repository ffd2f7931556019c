"""All claims of the paper, applied to what was run."""

from __future__ import annotations

from hdsafebo.report.claims.appendix import digit_claims, embedding_claims
from hdsafebo.report.claims.base import Claim, Verdict
from hdsafebo.report.claims.hand import hand_claims
from hdsafebo.report.claims.stimulation import round_time_claim, stimulation_claims
from hdsafebo.report.claims.synthetic import synthetic_claims
from hdsafebo.report.claims.theory import theory_claims
from hdsafebo.report.data.inputs import Isometry, Stimulation
from hdsafebo.report.data.results import Results


def paper_claims(
    results: Results, isometry: dict[str, Isometry] | None, stimulation: Stimulation | None
) -> list[Claim]:
    """Every claim of the paper with its verdict."""
    return [
        *synthetic_claims(results),
        *hand_claims(results),
        *stimulation_claims(results, stimulation),
        *embedding_claims(isometry),
        *digit_claims(results),
        *theory_claims(results, isometry),
        round_time_claim(results),
        _clinical(),
    ]


def _clinical() -> Claim:
    statement = (
        "In a patient, selectivity improved for 7 of 8 muscles over a month; 3 of 441 recommended "
        "configurations were unsafe."
    )
    reason = "not run: it needs a patient, a stimulator and an ethics board"
    rule = "Cannot be checked without a patient."
    return Claim("clinical", statement, "Section 5.3", rule, "clinical", {"": Verdict("not run", reason)})
