"""A recording of the largest size on its whole way: sent to the page, checked, kept, verified and copied."""

from __future__ import annotations

import json
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping, write_mapping
from hdsafebo.session.create import create_session
from hdsafebo.session.measuring import recording
from hdsafebo.session.patient.month import answer, simulated_patient
from hdsafebo.session.patient.responses import Responses
from tests.session.browser import free_port, wait_for
from tests.session.measuring.test_memory import csv_of_a_recording, edf_of_noise

_AGAIN = "import sys; from hdsafebo.cli import main; main(sys.argv[1:])"


class ServedAlone:
    """The page in a process of its own, whose memory can be told from ours."""

    def __init__(self, directory: Path) -> None:
        port = free_port()
        self.address = f"http://127.0.0.1:{port}/api/"
        command = [sys.executable, "-c", _AGAIN, "session", "serve", str(directory), "--port", str(port)]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for(self._answers, "the server")

    def _answers(self) -> bool:
        try:
            return bool(self.status())
        except OSError:
            return False

    def status(self) -> Any:
        with urllib.request.urlopen(self.address + "status", timeout=60) as answer_:
            return json.loads(answer_.read())

    def step(self, name: str, body: dict[str, Any], file: bytes = b"") -> None:
        head = {"who": "ann", "head": self.status()["head"]["hash"], **body}
        data = json.dumps(head).encode() + b"\n" + file
        request = urllib.request.Request(self.address + name, data, {"X-Session-Page": "1"}, method="POST")
        with urllib.request.urlopen(request, timeout=60) as answer_:
            assert answer_.status == 200

    def peak(self) -> int:
        """Largest memory since `forget`, in bytes."""
        lines = Path(f"/proc/{self.process.pid}/status").read_text().splitlines()
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))

    def forget(self) -> int:
        """Let the peak begin anew at the present size; this size."""
        Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")
        return self.peak()

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(20)


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="peaks are read from Linux' /proc")
@pytest.mark.parametrize(
    ("name", "content"),
    [("largest.csv", csv_of_a_recording), ("largest.edf", lambda size: edf_of_noise(size, False, 16))],
)
def test_recording_the_largest_file_takes_four_times_its_limit_at_most(
    tmp_path: Path, clinic_files: tuple[Path, Path], responses: Responses, name: str, content: Any
) -> None:
    definition, initial = clinic_files
    data = read_mapping(definition, ParamsError)
    data["emg"]["ignored_channels"] = ["AUX"]
    write_mapping(definition, data, ParamsError)
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial)
    polarity = [-1, 1, *[0] * 14]
    usual = {"point": {"polarity": polarity, "current_ma": 0.1}, "reason": "our usual one"}
    session.manual("ann", usual["point"], "our usual one")
    _, response = answer(session, simulated_patient(session, responses, 1))
    small = response.recording
    assert small is not None
    session.close()
    largest = content(recording.MAX_BYTES)
    served = ServedAlone(tmp_path / "s")
    try:
        took = []
        for file, label in ((small, "small.csv"), (largest, name)):  # the small one loads what reading needs
            before = served.forget()
            said = {"name": label, "bytes": len(file)}
            values = {"patient": 8, "therapist": 8}
            served.step("record", {"trial": None, "values": values, "recording": said}, file)
            took.append(served.peak() - before)
            if label != name:
                served.step("manual", usual)
        print(f"{name}, {len(largest) / 2**20:.0f} MiB: {took[1] / 2**20:.0f} MiB")
        assert took[1] <= 4 * recording.MAX_BYTES
    finally:
        served.stop()
