"""Peak memory of reading files, each in a process of its own.

    python -m tests.session.measuring.memory SMALL FILE KIND FILE KIND ...

prints for every FILE by how many bytes reading it raised the peak over the size that the process had after
reading SMALL (of the first kind), and what was said. Processes are forked: the program is imported once.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import time
from pathlib import Path

from hdsafebo.session.advice.setup import make_search, make_space
from hdsafebo.session.definition import StimulationDefinition, parse_definition
from hdsafebo.session.errors import SessionError
from hdsafebo.session.files import CANDIDATES, NamedFile
from hdsafebo.session.measuring.emg import activation, samples_digest
from hdsafebo.session.measuring.recordings import read_recording
from hdsafebo.session.measuring.tables import read_table
from tests.session.small import box_definition, small_definition


def read(kind: str, path: Path) -> None:
    """What a session does with a file that is handed in."""
    content = path.read_bytes()
    if kind == "recording":
        data = small_definition()
        data["emg"]["ignored_channels"] = ["AUX"]
        definition = parse_definition(data)
        assert isinstance(definition, StimulationDefinition)
        recording = read_recording(content, path.name, definition.emg)
        activation(recording, definition.emg)
        samples_digest(recording, definition.emg)
    elif kind == "initial":
        make_space(parse_definition(box_definition())).initial_trials(read_table(content, path.name))
    else:
        make_search(parse_definition(box_definition("list")), {CANDIDATES: NamedFile(path.name, content)})


def peak() -> int:
    """Largest memory of this process since `reset`, in bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def answered(kind: str, path: Path) -> str:
    """What is said about a file."""
    try:
        read(kind, path)
    except SessionError as error:
        return str(error)
    return "read"


def main() -> None:
    """See the module."""
    small, *rest = sys.argv[1:]
    files = list(zip(map(Path, rest[::2]), rest[1::2], strict=True))
    answered(files[0][1], Path(small))
    gc.collect()
    for path, kind in files:
        child = os.fork()
        if child == 0:
            Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew at the present size
            before, start = peak(), time.process_time()
            said = answered(kind, path)
            result = {"bytes": peak() - before, "seconds": time.process_time() - start, "said": said}
            print(json.dumps({"name": path.stem} | result), flush=True)
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0, path


if __name__ == "__main__":
    main()
