"""Pull and restore every device during a run; when is it noticed, when does the rover stop, does it recover?

    python -m benchmarks.unplug

Virtual runs of both shipped rovers. For each device in a role: the plug is pulled for one second
("unplug": the link reports it) or the device falls silent ("freeze": only its age tells). All times are
read from the log.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from drivers.clock import NANOSECONDS_PER_SECOND
from rover_hil.command_line.run import run_virtual
from rover_hil.config import Config, load_config
from rover_hil.loop.executive import End
from rover_hil.recording.log_reader import LogReader

FAULT_START_S = 4.0
FAULT_DURATION_S = 1.0
DETECTION_BAR_MS = 200
ZERO_BAR_MS = 150


def with_fault(config: Config, device: str, kind: str) -> Config:
    """Return `config` with one fault of one device."""
    table = config.model_dump(by_alias=True)
    table["simulation"]["faults"] = [
        {"type": kind, "device": device, "start_s": FAULT_START_S, "duration_s": FAULT_DURATION_S}
    ]
    return Config.model_validate(table)


def measure(log_path: Path, device: str) -> dict[str, object]:
    """Return times in ms from the log of a run with one fault."""
    log = LogReader(log_path)
    raw_ns: list[int] = []
    modes: list[tuple[int, str]] = []
    commands: list[tuple[int, float]] = []
    for message in log.messages():
        if message.topic == f"/raw/{device}":
            raw_ns.append(message.t_ns)
        elif message.topic in ("/estimate", "/command"):
            record = message.json()
            assert isinstance(record, dict)
            if message.topic == "/estimate":
                modes.append((message.t_ns, str(record["mode"])))
            else:
                commands.append((message.t_ns, max(abs(speed) for speed in record["speed_rad_s"])))
    begin_ns = log.start_ns + round(FAULT_START_S * NANOSECONDS_PER_SECOND)
    end_ns = begin_ns + round(FAULT_DURATION_S * NANOSECONDS_PER_SECOND)
    last_data_ns = max(t_ns for t_ns in raw_ns if t_ns <= begin_ns)
    detected_ns = next(t_ns for t_ns, mode in modes if t_ns > begin_ns and mode == "safe_stop")
    zero_ns = next(t_ns for t_ns, speed in commands if t_ns >= detected_ns and speed == 0)
    resumed_ns = next((t_ns for t_ns, mode in modes if t_ns > end_ns and mode == "running"), None)
    return {
        "detected_ms_after_last_data": round((detected_ns - last_data_ns) / 1e6, 1),
        "zero_ms_after_detection": round((zero_ns - detected_ns) / 1e6, 1),
        "zero_held_until_recovery": all(
            speed == 0 for t_ns, speed in commands if detected_ns <= t_ns < (resumed_ns or end_ns)
        ),
        "resumed_ms_after_replug": None if resumed_ns is None else round((resumed_ns - end_ns) / 1e6, 1),
        **_continuity(raw_ns, begin_ns, end_ns),
    }


def _continuity(raw_ns: Sequence[int], begin_ns: int, end_ns: int) -> Mapping[str, int]:
    """Count what the log holds from within the fault, and gaps outside of it."""
    before = [t_ns for t_ns in raw_ns if t_ns <= begin_ns]
    after = [t_ns for t_ns in raw_ns if t_ns > end_ns]
    periods_ns = sorted(later - earlier for earlier, later in pairwise(before))
    limit_ns = 2 * periods_ns[-1]
    gaps = sum(later - earlier > limit_ns for part in (before, after) for earlier, later in pairwise(part))
    invented = sum(begin_ns + limit_ns < t_ns <= end_ns for t_ns in raw_ns)
    return {"raw_during_fault": invented, "gaps_outside_fault": gaps}


def main() -> int:
    """Print the figures as JSON; exit code 1 when a bar is missed."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    rows: list[dict[str, object]] = []
    ok = True
    with tempfile.TemporaryDirectory() as folder:
        for name in ("robotino", "el-dorado"):
            config = load_config(name)
            for device in config.roles.names():
                for kind in ("unplug", "freeze"):
                    path = Path(folder) / f"{name}-{device}-{kind}.mcap"
                    result = run_virtual(
                        with_fault(config, device, kind), path, config.loop.time_limit_s, None
                    )
                    row = measure(path, device)
                    rows.append(
                        {"rover": name, "device": device, "fault": kind, **row, "end": str(result.end)}
                    )
                    ok = ok and _meets_bars(row) and result.end is End.FINISHED
    print(json.dumps({"bars_ms": [DETECTION_BAR_MS, ZERO_BAR_MS], "rows": rows}, indent=2))
    return 0 if ok else 1


def _meets_bars(row: Mapping[str, object]) -> bool:
    detected, zero = row["detected_ms_after_last_data"], row["zero_ms_after_detection"]
    assert isinstance(detected, float)
    assert isinstance(zero, float)
    return (
        detected <= DETECTION_BAR_MS
        and zero <= ZERO_BAR_MS
        and row["zero_held_until_recovery"] is True
        and row["resumed_ms_after_replug"] is not None
        and row["raw_during_fault"] == 0
        and row["gaps_outside_fault"] == 0
    )


if __name__ == "__main__":
    sys.exit(main())
