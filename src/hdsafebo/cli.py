"""The command line: `hdsafebo --help`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from hdsafebo import __version__
from hdsafebo.errors import HdSafeBOError, ParamsError, UnknownNameError
from hdsafebo.session.cli import add_parser as add_session_parser
from hdsafebo.session.errors import DefinitionError


def main(argv: Sequence[str] | None = None) -> None:
    """Run a subcommand; exit code 2 for bad input, 1 for other errors, without a traceback."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    try:
        arguments.run(arguments)
    except (DefinitionError, ParamsError, UnknownNameError) as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except HdSafeBOError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    except OSError as error:  # a disk that is full or read-only, a file that may not be read
        place = "" if error.filename is None else f"{error.filename}: "
        print(f"error: {place}{error.strerror or error}", file=sys.stderr)
        raise SystemExit(1) from None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="hdsafebo", description="Safe Bayesian optimisation in high dimensions."
    )
    parser.add_argument("--version", action="version", version=f"hdsafebo {__version__}")
    parser.add_argument(
        "--root", type=Path, default=Path.cwd(), help="directory of the project (default: here)"
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    profile = commands.add_parser(
        "profile", help="write params.yaml under a profile (smoke, standard, reference, paper)"
    )
    profile.add_argument("name")
    profile.add_argument("--force", action="store_true", help="overwrite an edited params.yaml")
    profile.set_defaults(run=_profile)

    check = commands.add_parser("check-params", help="check a parameter file and say what is wrong with it")
    check.add_argument("file", type=Path, nargs="?", help="default: ROOT/params.yaml")
    check.set_defaults(run=_check_params)

    methods = commands.add_parser("methods", help="list the optimisers")
    methods.set_defaults(run=_methods)

    mlflow = commands.add_parser("mlflow", help="open the MLflow UI on the local store of runs")
    mlflow.add_argument("--port", type=int, default=5000, help="of the page (default: 5000)")
    mlflow.set_defaults(run=_mlflow)

    add_session_parser(commands)

    report = commands.add_parser("report", help="build the report from kept evidence; no optimiser runs")
    report.add_argument(
        "--from",
        dest="evidence",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder of the evidence, such as reports/reference",
    )
    report.add_argument("--to", type=Path, metavar="DIR", help="folder of the report (default: the same)")
    report.set_defaults(run=_report)

    departures = commands.add_parser("departures", help="print docs/departures.md")
    departures.set_defaults(run=_departures)

    keep = commands.add_parser(
        "keep-reference",
        help="keep the evidence of the runs made so far in reports/reference, and its report",
    )
    keep.set_defaults(run=_keep_reference)
    return parser


def _profile(arguments: argparse.Namespace) -> None:
    from hdsafebo.pipeline.profiles import apply_profile

    changed = apply_profile(arguments.root, arguments.name, force=arguments.force)
    print(f"params.yaml {'now holds' if changed else 'already held'} the profile {arguments.name}")


def _check_params(arguments: argparse.Namespace) -> None:
    from hdsafebo.pipeline.checked_params import load_checked_params
    from hdsafebo.pipeline.checked_settings import check_settings

    path = arguments.file or arguments.root / "params.yaml"
    params = load_checked_params(path)
    check_settings(params, str(path))
    print(f"{path}: valid, profile {params.profile}")


def _methods(arguments: argparse.Namespace) -> None:
    from hdsafebo.optimizers.registry import method_names

    print("\n".join(method_names()))


def _report(arguments: argparse.Namespace) -> None:
    from hdsafebo.report.reference import report_from

    output = arguments.to or arguments.evidence
    report_from(arguments.evidence, output)
    print(f"{output / 'index.html'}")


def _departures(arguments: argparse.Namespace) -> None:
    from hdsafebo.report.sections.departures import departures_markdown

    print(departures_markdown(), end="")


def _mlflow(arguments: argparse.Namespace) -> None:
    import os

    from hdsafebo.pipeline.store import default_uri, experiments

    # MLflow opens an experiment on its page for traces of language models unless the address says otherwise.
    for name, number in experiments(arguments.root).items():
        page = f"http://127.0.0.1:{arguments.port}/#/experiments/{number}?workflowType=machine_learning"
        print(f"{name}: {page}", flush=True)
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    # One person looks: MLflow would start four servers, and six consumers of jobs that nothing here submits.
    os.environ.setdefault("MLFLOW_SERVER_ENABLE_JOB_EXECUTION", "false")
    command = [sys.executable, "-m", "mlflow", "ui", "--host", "127.0.0.1", "--port", str(arguments.port)]
    os.execv(sys.executable, [*command, "--workers", "1", "--backend-store-uri", default_uri(arguments.root)])


def _keep_reference(arguments: argparse.Namespace) -> None:
    from hdsafebo.report.reference import keep_reference

    folder, missing = keep_reference(arguments.root)
    print(f"kept in {folder}")
    by_task: dict[str, list[str]] = {}
    for name in missing:
        task, method = name.split("-", 1)
        by_task.setdefault(task, []).append(method)
    for task, methods in by_task.items():
        print(f"not run yet: {task}: {', '.join(methods)}")


if __name__ == "__main__":
    main()
