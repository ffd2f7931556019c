"""The built site: what its checker notices; and, slow, that it works from the disk and can be searched."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.session.browser import CHROMIUM, DRIVER, Browser, wait_for
from tools.check_site import faults
from tools.docs.offline import finish

GOOD = '<a id="top" href="b.html#there">b</a><a href="https://elsewhere">c</a><img src="p.png" alt="p">'


def site(folder: Path, page: str) -> Path:
    (folder / "a.html").write_text(page)
    (folder / "b.html").write_text('<h2 id="there">b</h2><a href="a.html">a</a>')
    (folder / "p.png").write_bytes(b"picture")
    return folder


def test_a_good_site_has_no_faults(tmp_path: Path) -> None:
    assert faults(site(tmp_path, GOOD)) == []
    assert faults(tmp_path / "nothing") == [f"{tmp_path / 'nothing'}: no pages"]


@pytest.mark.parametrize(
    ("was", "becomes", "message"),
    [
        ("b.html#there", "c.html", "a.html: link to c.html, which is not there"),
        ("b.html#there", "b.html#here", "a.html: link to b.html#here, where no such anchor is"),
        ("b.html#there", "#here", "a.html: link to #here, where no such anchor is"),
        ("b.html#there", "../b.html", "which is not there"),
        (' alt="p"', "", "picture p.png has no text alternative"),
        ("p.png", "q.png", "link to q.png, which is not there"),
        ('src="p.png"', 'src="https://elsewhere/p.png"', "is fetched from the network"),
    ],
)
def test_a_fault_is_noticed(tmp_path: Path, was: str, becomes: str, message: str) -> None:
    (fault,) = faults(site(tmp_path, GOOD.replace(was, becomes)))
    assert message in fault


def test_a_large_site_is_noticed(tmp_path: Path) -> None:
    (site(tmp_path, GOOD) / "p.png").write_bytes(bytes(16_000_000))
    (fault,) = faults(tmp_path)
    assert "16.0 MB, expected at most 15" in fault


def test_what_the_theme_fetches_comes_from_the_site(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    page = tmp_path / "deep/a.html"
    page.write_text('<script src="https://unpkg.com/iframe-worker/shim" type="text/javascript"></script>')
    assert finish(tmp_path) == 1
    assert page.read_text() == '<script src="../assets/worker.js"></script>'
    assert finish(tmp_path) == 0


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="needs Chromium and its driver")
def test_the_site_is_built_and_searched_from_the_disk(project_root: Path, tmp_path: Path) -> None:
    for name in ("docs", "src", "mkdocs.yml", "CONTRIBUTING.md"):
        copy = shutil.copytree if (project_root / name).is_dir() else shutil.copy
        copy(project_root / name, tmp_path / name)
    zensical = Path(sys.executable).with_name("zensical")
    build = [zensical, "build", "--strict", "--config-file", "mkdocs.yml"]
    done = subprocess.run(build, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert "griffe" not in done.stdout + done.stderr, "a docstring that the reference cannot read"
    built = tmp_path / "site"
    assert finish(built) > 50
    assert faults(built) == []
    with Browser(tmp_path / "profile") as browser:
        browser.open((built / "index.html").as_uri())
        browser.click(".md-search__button")
        shown = "return document.activeElement.shadowRoot !== null"
        wait_for(lambda: browser.run(shown), "the search")
        typed = (
            "window.found = document.activeElement.shadowRoot; const input = found.querySelector('input');"
            "input.value = 'calibration'; input.dispatchEvent(new Event('input', {bubbles: true})); return 1"
        )
        browser.run(typed)
        wait_for(lambda: "results" in browser.run("return found.textContent"), "results")
        assert browser.errors() == []
