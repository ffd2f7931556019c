"""What every pipeline stage shares: parameters, paths, tracking, and errors without tracebacks."""

from __future__ import annotations

import argparse
import json
import logging
import resource
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from safetensors import SafetensorError

from hdsafebo.errors import HdSafeBOError, ParamsError, UnknownNameError
from hdsafebo.params import Params
from hdsafebo.pipeline.checked_params import load_checked_params
from hdsafebo.pipeline.store import home_of
from hdsafebo.pipeline.tracking import Tracker, track_stage
from hdsafebo.threads import one_thread

_LOG = logging.getLogger(__name__)
EXIT_FAILED = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130  # as shells have it: 128 + SIGINT
COSTS_FILE = ".journal/stage_costs.jsonl"


class Stage:
    """A running stage.

    Attributes:
        name: the stage's name in `dvc.yaml`.
        params: the checked parameters.
        root: the project's directory.
        options: the stage's own command line options.
        tracker: mirrors numbers and files to the tracking server.
    """

    def __init__(
        self, name: str, params: Params, root: Path, options: argparse.Namespace, tracker: Tracker
    ) -> None:
        self.name = name
        self.params = params
        self.root = root
        self.options = options
        self.tracker = tracker
        self.last_path = root

    def path(self, relative: str) -> Path:
        """A path below the project's directory; its parent directories are made."""
        path = self.last_path = self.root / relative
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Mirror numbers to the tracking server, where tracking is on."""
        self.tracker.log_metrics(dict(metrics), step=step)

    def log_artifact(self, path: Path) -> None:
        """Mirror a file or a directory to the tracking server, where tracking is on."""
        self.tracker.log_artifact(path)

    def notice(self, message: str) -> None:
        """Tell the user something that must not be missed."""
        _LOG.warning("NOTICE [%s]: %s", self.name, message)


def run_stage(
    name: str,
    main: Callable[[Stage], None],
    *,
    blocks: Sequence[str] = (),
    options: Callable[[argparse.ArgumentParser], None] | None = None,
    argv: Sequence[str] | None = None,
) -> None:
    """Run a stage script: parse the command line, check the parameters, do the work, and exit.

    Args:
        name: name of the stage.
        main: the work.
        blocks: dotted keys of `params.yaml` that the stage uses (mirrored to the tracking server).
        options: adds the stage's own command line options.
        argv: command line; None takes the process's.

    The work is done with one thread per process: a stage's files do not depend on the machine's cores, and
    what is done side by side is done in processes.

    The exit code is 2 for bad parameters, 1 for any other error that the package raises on purpose.
    """
    parser = argparse.ArgumentParser(
        prog=f"python stages/{name}.py", description=main.__doc__ or f"Run the stage {name}."
    )
    parser.add_argument(
        "--root", type=Path, default=Path.cwd(), help="directory of the project (default: here)"
    )
    parser.add_argument(
        "--params", type=Path, default=None, help="parameter file (default: ROOT/params.yaml)"
    )
    if options is not None:
        options(parser)
    arguments = parser.parse_args(argv)
    with _messages_on_stderr():
        _run(name, main, blocks, arguments)


def _run(
    name: str, main: Callable[[Stage], None], blocks: Sequence[str], arguments: argparse.Namespace
) -> None:
    root = arguments.root.resolve()
    start = time.perf_counter()
    stage = None
    try:
        params = load_checked_params(arguments.params or root / "params.yaml")
        tracked = {block: lookup(params, block) for block in blocks}
        with track_stage(name, tracked, root, enabled=params.tracking.enabled) as tracker:
            stage = Stage(name, params, root, arguments, tracker)
            with one_thread():
                main(stage)
    except (ParamsError, UnknownNameError) as error:
        _LOG.error("error: %s", error)
        raise SystemExit(EXIT_BAD_INPUT) from None
    except HdSafeBOError as error:
        _LOG.error("error in stage %s: %s", name, error)
        raise SystemExit(EXIT_FAILED) from None
    except (OSError, SafetensorError) as error:  # a disk that is full or read-only; writers seldom say where
        place = getattr(error, "filename", None) or (stage.last_path if stage else root)
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        _LOG.error(
            "error in stage %s: %s: %s; start the stage again when this path can be written",
            name,
            place,
            reason,
        )
        raise SystemExit(EXIT_FAILED) from None
    except KeyboardInterrupt:
        _LOG.error("stage %s was interrupted; finished rounds of its runs are kept: start it again", name)
        raise SystemExit(EXIT_INTERRUPTED) from None
    seconds = time.perf_counter() - start
    _record_cost(root, params.profile, name, arguments, seconds)
    _LOG.info("%s: done in %.1f s", name, seconds)


@contextmanager
def _messages_on_stderr() -> Iterator[None]:
    """Let messages of the package appear as they are, information too, while a stage runs."""
    logger = logging.getLogger("hdsafebo")
    handler, level = logging.StreamHandler(), logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


def _record_cost(root: Path, profile: str, name: str, arguments: argparse.Namespace, seconds: float) -> None:
    """Append wall time and peak memory of the stage to a log outside DVC's outs, which must not change."""
    item = [str(value) for key, value in vars(arguments).items() if key not in ("root", "params")]
    peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    cost = {"profile": profile, "stage": name, "item": item, "seconds": round(seconds, 1)}
    path = home_of(root) / COSTS_FILE
    try:
        path.parent.mkdir(exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(cost | {"peak_mb": round(peak / 1024)}) + "\n")
    except OSError as error:
        _LOG.warning("NOTICE [%s]: %s cannot be written: %s", name, path, error.strerror)


def lookup(params: Params, key: str) -> object:
    """The plain value of a dotted key of the parameters, as in `spinal.mesh`."""
    value: object = params.model_dump(mode="json")
    for part in key.split("."):
        if not isinstance(value, dict) or part not in value:
            raise ParamsError(f"{key}: no such key in the parameters")
        value = value[part]
    return value
