"""Which modules each stage, task and method uses, to data/code: what the other stages depend on for code."""

from __future__ import annotations

import sys
from pathlib import Path

from hdsafebo.errors import HdSafeBOError
from hdsafebo.pipeline.checked_params import load_checked_params
from hdsafebo.pipeline.code import write_code_files

if __name__ == "__main__":
    try:
        params = load_checked_params(Path("params.yaml"))
        write_code_files(Path.cwd(), {name: method.algorithm for name, method in params.methods.items()})
    except (HdSafeBOError, SyntaxError) as error:
        print(f"error in stage code: {error}", file=sys.stderr)
        raise SystemExit(1) from None
