"""Write the pages that come from the code, and finish the built site.

python -m tools.docs                  write pages
python -m tools.docs --tutorials      run the tutorials, too
python -m tools.docs --finish site    after the build: nothing is fetched from the network
"""

from __future__ import annotations

import argparse
from pathlib import Path

from hdsafebo.report.marked import write_marked
from hdsafebo.report.published import publish
from tools.docs import offline, pages, tutorials

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Write them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tutorials", action="store_true", help="run the tutorials, too: a minute or two")
    parser.add_argument("--finish", type=Path, metavar="SITE", help="only make a built site work offline")
    given = parser.parse_args()
    if given.finish is not None:
        offline.finish(given.finish)
        return
    publish(ROOT)
    for path, text in pages.whole(ROOT).items():
        (ROOT / path).parent.mkdir(parents=True, exist_ok=True)
        (ROOT / path).write_text(text, encoding="utf-8")
    for (path, name), text in pages.parts(ROOT).items():
        write_marked(ROOT / path, name, text)
    for path in pages.stale(ROOT):
        path.unlink()
    if given.tutorials:
        tutorials.write(ROOT)


if __name__ == "__main__":
    main()
