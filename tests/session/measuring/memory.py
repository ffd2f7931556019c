"""Peak memory of reading one file, measured in a process of its own.

    python -m tests.session.measuring.memory recording|table|initial|candidates FILE

prints by how many bytes the peak rose over that of the same process with everything imported, after it has read a
small file of the same kind, and what was said about the file.
"""

from __future__ import annotations

import gc
import json
import sys
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
        definition = parse_definition(small_definition())
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


def main() -> None:
    """See the module."""
    kind, small, path = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    said = ""
    try:
        read(kind, small)
    except SessionError as error:
        said = str(error)
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew at the present size
    before = peak()
    try:
        read(kind, path)
        said = "read"
    except SessionError as error:
        said = str(error)
    print(json.dumps({"bytes": peak() - before, "said": said}))


if __name__ == "__main__":
    main()
