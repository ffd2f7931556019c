"""The section of the whole body: times to the fall, pictures, and what fails."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.report.build import build_report
from hdsafebo.report.data.body_inputs import FILM, POLICIES, BodyInputs, BodyPolicies, read_body
from hdsafebo.report.data.inputs import StoredFilm, StoredPicture
from hdsafebo.report.data.results import Results
from hdsafebo.report.sections.base import Text
from hdsafebo.report.sections.body import body_section
from hdsafebo.report.tables.body import standing_table, standings
from hdsafebo.report.tables.results import Table
from hdsafebo.runs.read import read_runs
from report.run_files import trial_table, write_run


def entry(
    method: str, seed: int, known: list[float], unseen: list[float], picture: str | None = None
) -> dict:
    def outcome(seconds: list[float]) -> dict:
        return {
            "seconds": seconds,
            "loads": [10.0 * s for s in seconds],
            "total": sum(seconds),
            "failure": None,
        }

    return {
        "method": method,
        "seed": seed,
        "trial": 3,
        "objective": sum(known),
        "known": outcome(known),
        "unseen": outcome(unseen) if unseen else None,
        "picture": picture,
    }


ENTRIES = [
    entry("reflex", 0, [2.0, 3.0], [1.0, 2.0], "reflex.png"),
    entry("reflex", 1, [2.0, 2.0], [2.0, 2.0]),
    entry("hdsafebo_local", 0, [5.0, 5.0], [3.0, 3.0], "hdsafebo_local.png"),
    entry("hdsafebo_local", 1, [5.0, 4.0], [3.0, 4.0]),
]


def content(missing: str | None = None, entries: list[dict] = ENTRIES) -> dict:
    return {
        "horizon_s": 5.0,
        "pushes": [1, 4],
        "unseen_pushes": [101, 102],
        "missing": missing,
        "policies": entries,
    }


def write(root: Path, data: dict) -> BodyInputs:
    folder = root / POLICIES
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "policies.json").write_text(json.dumps(data))
    if data["missing"] is None:
        (folder / "reflex.png").write_bytes(b"\x89PNG reflex")
        (folder / "hdsafebo_local.png").write_bytes(b"\x89PNG learnt")
        (folder / FILM).write_bytes(b"film")
    return read_body(root)


def test_whole_episodes_and_twice_the_reflex_are_counted() -> None:
    reflex, learnt = standings(BodyPolicies.model_validate(content()))
    assert (reflex.whole, reflex.longer) == (0, None)
    assert (learnt.whole, learnt.longer) == (1, 1), "seed 0 stands 6 of 3 s after new pushes, seed 1 7 of 4"
    assert learnt.load == 50.0


def test_times_are_medians_over_seeds() -> None:
    table = standing_table(BodyPolicies.model_validate(content()))
    row = table.frame.set_index("method").loc["hdsafebo_local"]
    assert (row["push_1_s"], row["push_4_s"]) == (5.0, 4.5)
    assert (row["push_101_s"], row["push_102_s"], row["unseen_mean_s"]) == (3.0, 3.5, 3.25)
    assert len(table.columns) == len(table.rows[0])


def test_the_section_shows_pictures_and_says_what_fails(tmp_path: Path) -> None:
    body = write(tmp_path, content())
    table = trial_table(0, [1.0, 2.0, 3.0], [1.0, -1.0, 1.0], n_initial=1, batch=1)
    write_run(tmp_path, "body", "hdsafebo_local", [table], n_initial=1, batch=1)
    blocks = body_section(Results(read_runs(tmp_path / "data/runs")), body).blocks
    told = "\n".join(block.text for block in blocks if isinstance(block, Text))
    assert "HdSafeBO-local: 50.0 % of the chosen trials unsafe, 0 marked" in told
    assert "1 of 4 episodes after known pushes and 4 of 4 after new ones end in a fall" in told
    assert [block.data for block in blocks if isinstance(block, StoredPicture)] == [
        b"\x89PNG reflex",
        b"\x89PNG learnt",
    ]
    [film] = [block for block in blocks if isinstance(block, StoredFilm)]
    assert film.title.endswith("after one push: HdSafeBO-local and Best initial reflex.")
    assert "body_standing" in [block.name for block in blocks if isinstance(block, Table)]


def test_the_page_plays_the_film(tmp_path: Path) -> None:
    write(tmp_path, content())
    build_report(tmp_path, profile="test", git_revision=None)
    page = (tmp_path / "reports/index.html").read_text()
    [film] = (tmp_path / "reports/figures").glob("film_*.mp4")
    assert film.read_bytes() == b"film"
    assert f'<video src="figures/{film.name}"' in page


def test_without_a_renderer_the_section_says_so(tmp_path: Path) -> None:
    blocks = body_section(Results({}), write(tmp_path, content("no OpenGL renderer"))).blocks
    told = "\n".join(block.text for block in blocks if isinstance(block, Text))
    assert "No pictures of the body: no OpenGL renderer." in told
    assert "Times until the fall: not run" not in told


def test_nothing_was_made(tmp_path: Path) -> None:
    assert read_body(tmp_path) == BodyInputs(None, {}, None)
    told = "\n".join(
        b.text for b in body_section(Results({}), read_body(tmp_path)).blocks if isinstance(b, Text)
    )
    assert "Pictures of the body: not run" in told
    assert "Times until the fall: not run" in told


def test_without_new_pushes_the_table_has_none() -> None:
    entries = [entry("reflex", 0, [2.0, 3.0], []), entry("cmaes_tuned", 0, [5.0, 5.0], [])]
    data = content(entries=entries) | {"unseen_pushes": []}
    played = BodyPolicies.model_validate(data)
    assert [one.longer for one in standings(played)] == [None, None]
    assert standing_table(played).columns == ["Policy", "push 1", "push 4", "Whole ↑", "Twice ↑", "Load ↓"]


@pytest.mark.parametrize("text", ["{", "{}", '{"horizon_s": 1}'])
def test_malformed_files_are_errors(tmp_path: Path, text: str) -> None:
    (tmp_path / POLICIES).mkdir(parents=True)
    (tmp_path / POLICIES / "policies.json").write_text(text)
    with pytest.raises(DatasetError, match=r"policies\.json"):
        read_body(tmp_path)
