"""Turn a measured run into a log: its bytes pass through the same codec as those of a live rover."""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from drivers.clock import VirtualClock
from drivers.errors import ConfigError
from drivers.link import Received
from rover_hil.config import Config, RoleSettings
from rover_hil.drives.formats.robotino_csv import BoardRow
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.schema import CYCLE, SET_POINT, TRUTH
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import build_replay_rig


def observing_config(config: Config, devices: Collection[str] = ()) -> Config:
    """Return `config` reduced to its wheels and some devices: no mission, no slip map, nothing simulated."""
    roles = config.roles
    kept = {roles.wheels, *devices}
    return config.model_copy(
        update={
            "roles": RoleSettings(
                wheels=roles.wheels,
                gyro=roles.gyro if roles.gyro in kept else None,
                headings=tuple(name for name in roles.headings if name in kept),
            ),
            "devices": {name: device for name, device in config.devices.items() if name in kept},
            **dict.fromkeys(("mission", "slip", "scomp", "simulation", "tune")),
        }
    )


def write_run_as_log(
    rows: Sequence[BoardRow], source: str, config: Config, path: Path, *, with_estimate: bool = True
) -> Iterator[int]:
    """Write a measured run to the log `path`, row by row; yields the number of rows written so far.

    Args:
        rows: Of the run.
        source: Name of its file.
        config: As `observing_config` returns it.
        path: The log; must not exist.
        with_estimate: Whether the loop runs; without it the log holds what the board sent, and its samples.

    Raises:
        ConfigError: The wheels of `config` are not a Robotino board.
    """
    wheels = config.roles.wheels
    if config.devices[wheels].type != "robotino_board":
        raise ConfigError(
            f"roles.wheels is '{wheels}', not a robotino_board: a measured Robotino run needs one"
        )
    clock = VirtualClock(rows[0].t_ns)
    config_json = config.model_dump_json(by_alias=True).encode()
    files = collect_data_files(config)
    with LogWriter(path, clock.now_ns(), config_json, files, f"imported from {source}") as log:
        rig, links = build_replay_rig(config, clock, log)
        rig.connect(timeout_s=0.0)
        for count, row in enumerate(rows, start=1):
            clock.sleep_until(row.t_ns)
            links.bytes_links[wheels].feed(Received(row.t_ns, row.reply_frame))
            samples = rig.poll()
            log.samples(row.t_ns, samples)
            if with_estimate:
                log.estimate(rig.loop.step(row.t_ns, samples))
            log.write_json(SET_POINT, row.t_ns, {"speed_rad_s": row.set_speed_rad_s})
            log.write_json(TRUTH, row.t_ns, row.truth)
            log.write_json(CYCLE, row.t_ns, {"late_ns": 0, "work_ns": 0})
            yield count
