"""Check the built documentation: every internal link and anchor leads somewhere, pictures have a text
alternative, nothing is fetched from the network, and the whole is small.

    python tools/check_site.py site
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LARGEST_MB = 15


class Page(HTMLParser):
    """Links, anchors, pictures and files of a page.

    Args:
        text: of the page.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.files: list[str] = []
        self.without_text: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take in a tag."""
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag in ("img", "script", "iframe", "source") and "src" in values:
            self.files.append(values["src"])
        if tag == "link" and values.get("rel") in ("stylesheet", "icon", "preload"):
            self.files.append(values.get("href", ""))
        if tag == "img" and not values.get("alt"):
            self.without_text.append(values.get("src", "?"))


def faults(site: Path) -> list[str]:
    """What is wrong with a site, one line each."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    found = [] if pages else [f"{site}: no pages"]
    for path, page in pages.items():
        if path.name == "404.html":  # its links are of the place where the site will be served
            continue
        where = path.relative_to(site)
        found += [f"{where}: picture {name} has no text alternative" for name in page.without_text]
        for target in page.files + page.links:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                if target in page.files:
                    found.append(f"{where}: {target} is fetched from the network")
                continue
            goal = path if not parts.path else (path.parent / unquote(parts.path)).resolve()
            goal = goal / "index.html" if goal.is_dir() else goal
            if not goal.exists() or (not goal.is_relative_to(site.resolve()) and goal != path):
                found.append(f"{where}: link to {target}, which is not there")
            elif parts.fragment and goal.suffix == ".html":
                anchors = (page if goal == path else pages[site / goal.relative_to(site.resolve())]).anchors
                if unquote(parts.fragment) not in anchors:
                    found.append(f"{where}: link to {target}, where no such anchor is")
    megabytes = sum(path.stat().st_size for path in site.rglob("*") if path.is_file()) / 1e6
    if megabytes > LARGEST_MB:
        found.append(f"{site}: {megabytes:.1f} MB, expected at most {LARGEST_MB}")
    return found


def main() -> None:
    """Print what is wrong; exit code 1 where something is."""
    found = faults(Path(sys.argv[1]))
    print("\n".join(found) or f"{sys.argv[1]}: every link leads somewhere")
    raise SystemExit(bool(found))


if __name__ == "__main__":
    main()
