"""Pull and restore every device during a run: when is it noticed, when does the rover stop, does it recover?

    python -m benchmarks.program.unplug [--realtime]

Both shipped rovers, virtual or (--realtime) as two processes over pseudo-terminals and slcan. For each
device in a role the plug is pulled for a second ("unplug": the link reports it), or the device falls silent
for as long ("freeze": only its age shows it). All times are read from the log. In real time, "other_gaps" are
the scheduler's and no failure; what was lost or damaged on the way is in "rejected".
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from drivers.clock import SystemClock, nanoseconds
from rover_hil.config import Config, load_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.driving import run_virtual

PROGRAM = str(Path(sys.executable).with_name("rover-hil"))
CONFIGS = Path(__file__).parents[2] / "rover_hil" / "config" / "shipped" / "configs"
PORTS_S = 60.0
"""Loading the simulator takes long on a loaded machine."""
FAULT_START_S = 4.0
FAULT_DURATION_S = 1.0
RUN_S = 8.0
DETECTION_BAR_MS = 200.0
ZERO_BAR_MS = 150.0
LONGEST_SILENCE_MS = 1e3 * FAULT_DURATION_S + 1100.0
"""The fault, and the longest wait between two attempts to reopen a port."""


def fault_text(device: str, kind: str) -> str:
    """Return the lines of a configuration that let a device fail."""
    return (
        f'\n[[simulation.faults]]\ntype = "{kind}"\ndevice = "{device}"\n'
        f"start_s = {FAULT_START_S}\nduration_s = {FAULT_DURATION_S}\n"
    )


def run_in_one_process(config: Config, folder: Path) -> None:
    """Run on simulated time."""
    run_virtual(config, folder / "run.mcap", RUN_S, None)


def run_in_two_processes(config: Config, folder: Path, run_s: float = RUN_S) -> None:
    """Serve the simulated rover and run it in real time; both read `rover.toml` in `folder`."""
    simulator = subprocess.Popen([PROGRAM, "simulate", "rover.toml"], cwd=folder, stdout=subprocess.DEVNULL)
    try:
        _wait_for_ports(config, folder)
        command = [PROGRAM, "run", "rover.toml", "--duration", str(run_s), "--out", "."]
        # Exit code 1: the run did not end as it should; its log states why.
        if subprocess.run(command, cwd=folder, check=False, stdout=subprocess.DEVNULL).returncode > 1:
            raise SystemExit(f"`{' '.join(command)}` failed: see above")
    finally:
        simulator.send_signal(signal.SIGINT)
        simulator.wait()


def _wait_for_ports(config: Config, folder: Path) -> None:
    """Wait until the simulator has made the ports."""
    named = (device.exclusive_port() for device in config.devices.values())
    ports = [folder / path for _, path in filter(None, named)]
    clock = SystemClock()
    end_ns = clock.now_ns() + nanoseconds(PORTS_S)
    while not all(port.exists() for port in ports) and clock.now_ns() < end_ns:
        clock.sleep_until(clock.now_ns() + nanoseconds(0.05))


def measure(log_path: Path, device: str) -> dict[str, object]:
    """Return times in ms from the log of a run in which `device` failed once."""
    raw_ns: list[int] = []
    modes: list[tuple[int, str]] = []
    commands: list[tuple[int, float]] = []
    rejected: object = {}
    for message in LogReader(log_path).messages():
        if message.topic == f"/raw/{device}":
            raw_ns.append(message.t_ns)
        elif message.topic == "/health":
            healths = message.json()
            assert isinstance(healths, list)
            rejected = next(health["rejected"] for health in healths if health["device"] == device)
        elif message.topic in ("/estimate", "/command"):
            record = message.json()
            assert isinstance(record, dict)
            if message.topic == "/estimate":
                modes.append((message.t_ns, str(record["mode"])))
            else:
                commands.append((message.t_ns, max(abs(speed) for speed in record["speed_rad_s"])))
    detected_ns = next((t_ns for t_ns, mode in modes if mode == "safe_stop"), None)
    if detected_ns is None:
        raise SystemExit(
            f"{device}: no stop in the run. In real time the device fails {FAULT_START_S:g} s after the "
            "simulator starts: on a loaded machine that is before the run"
        )
    resumed_ns = next(t_ns for t_ns, mode in modes if t_ns > detected_ns and mode == "running")
    zero_ns = next(t_ns for t_ns, speed in commands if t_ns >= detected_ns and speed == 0)
    silent_ns, back_ns = _longest_silence(raw_ns)
    return {
        "detected_ms_after_last_data": round((detected_ns - silent_ns) / 1e6, 1),
        "zero_ms_after_detection": round((zero_ns - detected_ns) / 1e6, 1),
        "zero_held_until_recovery": all(
            speed == 0 for t_ns, speed in commands if zero_ns <= t_ns < resumed_ns
        ),
        "silence_ms": round((back_ns - silent_ns) / 1e6, 1),
        "resumed_ms_after_first_data": round((resumed_ns - back_ns) / 1e6, 1),
        "other_gaps": _gaps(raw_ns, silent_ns, back_ns),
        "rejected": rejected,
    }


def _longest_silence(raw_ns: Sequence[int]) -> tuple[int, int]:
    return max(pairwise(raw_ns), key=lambda pair: pair[1] - pair[0])


def _gaps(raw_ns: Sequence[int], silent_ns: int, back_ns: int) -> int:
    """Count silences, but for the one of the fault, longer than three times the usual longest."""
    gaps_ns = sorted(
        later - earlier for earlier, later in pairwise(raw_ns) if not silent_ns <= earlier < back_ns
    )
    usual_ns = gaps_ns[round(0.95 * (len(gaps_ns) - 1))]
    return sum(gap_ns > 3 * usual_ns for gap_ns in gaps_ns)


def meets_bars(row: Mapping[str, object], *, is_realtime: bool) -> bool:
    """Return whether a row is as it must be."""
    numbers = {name: value for name, value in row.items() if isinstance(value, int | float)}
    return (
        numbers["detected_ms_after_last_data"] <= DETECTION_BAR_MS
        and numbers["zero_ms_after_detection"] <= ZERO_BAR_MS
        and row["zero_held_until_recovery"] is True
        and numbers["silence_ms"] <= LONGEST_SILENCE_MS
        and (is_realtime or numbers["other_gaps"] == 0)
    )


def main() -> int:
    """Print the figures as JSON; exit code 1 when a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--realtime", action="store_true")
    is_realtime = parser.parse_args().realtime
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder_name:
        for name in ("robotino", "el-dorado"):
            text = (CONFIGS / f"{name}.toml").read_text()
            for device in load_config(name).roles.names():
                for kind in ("unplug", "freeze"):
                    folder = Path(folder_name) / f"{name}-{device}-{kind}"
                    folder.mkdir()
                    (folder / "rover.toml").write_text(text + fault_text(device, kind))
                    config = load_config(str(folder / "rover.toml"))
                    (run_in_two_processes if is_realtime else run_in_one_process)(config, folder)
                    row = measure(folder / "run.mcap", device)
                    rows.append(
                        {
                            "rover": name,
                            "device": device,
                            "fault": kind,
                            **row,
                            "ok": meets_bars(row, is_realtime=is_realtime),
                        }
                    )
    bars = {"detected_ms_after_last_data": DETECTION_BAR_MS, "zero_ms_after_detection": ZERO_BAR_MS}
    print(json.dumps({"realtime": is_realtime, "bars": bars, "rows": rows}, indent=1))
    return 0 if all(row["ok"] is True for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
