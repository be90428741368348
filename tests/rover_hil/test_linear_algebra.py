"""With little memory left a run does not hang in the first call of its linear algebra."""

import subprocess
import sys
from pathlib import Path

import pytest

RUN = """
import resource
from pathlib import Path
from rover_hil.run.driving import run_virtual
from rover_hil.config import load_config
from rover_hil.run.composition import Rig

connect_now = Rig.connect

def connect(rig, timeout_s):
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + {spare_bytes}
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    connect_now(rig, timeout_s)

Rig.connect = connect
print(run_virtual(load_config("robotino"), Path("run.mcap"), 6.0, None).reason)
"""
SPARE_BYTES = 16_000_000
"""Enough for a run of seconds, too little for the working memory of OpenBLAS, twice of this or more."""
PATIENCE_S = 100.0


@pytest.mark.slow
def test_the_working_memory_is_allocated_before_the_drive_opens(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", RUN.format(spare_bytes=SPARE_BYTES)],
        check=False,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=PATIENCE_S,
    )
    assert done.stdout == "time over in mode 'running'\n", done.stderr
