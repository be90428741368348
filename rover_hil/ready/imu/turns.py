"""Small turns in a log: angle by the wheels and readings of the gyro, where the rover does not travel."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from controllers.motion.rover_geometry import OmniRoverSettings
from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import read_drive
from rover_hil.ready.imu.parameters import GYRO_FIT

TURNS = GYRO_FIT.turns


@dataclass(frozen=True, slots=True, kw_only=True)
class Turns:
    """Turns of a rover in place.

    Attributes:
        path: The log.
        wheel_age_s: Age of the wheels' positions at their time stamp by the settings of their device; 0 where
            it is unknown.
        grid_s: Times, `TURNS.grid_s` apart, shape (n,).
        wheel_rate_rad_s: Yaw rate of rolling wheels at these times, (n,).
        gyro_s: Time stamps of the gyro, (k,).
        gyro_rad_s: Its readings, (k,).
        blocks: Begin of each block in which the rover turns in place, (m,).
        rates_ratio: Distance of the ratio of the loop's rate and the gyro's from 1.
    """

    path: Path
    wheel_age_s: float
    grid_s: Array
    wheel_rate_rad_s: Array
    gyro_s: Array
    gyro_rad_s: Array
    blocks: Array
    rates_ratio: float


def read_turns(path: Path) -> Turns:
    """Return the turns on the spot of a log.

    Raises:
        LogError: The log is damaged, is of another kind of rover, has no gyro, or the rover hardly turned in
            place.
    """
    drive = read_drive(path)
    config = drive.config
    if not isinstance(config.rover, OmniRoverSettings):
        raise LogError(
            f"{path} is of a rover with kinematics '{config.rover.kinematics}': "
            "the gyro is identified with three omnidirectional wheels"
        )
    gyro, rolled = drive.channels["gyro_z_rad_s"], drive.rolled(TURNS.least_readings)
    if len(gyro) < TURNS.least_readings or rolled is None:
        raise LogError(f"log {path} holds no yaw rates of roles.gyro, or no positions of all wheels")
    origin_ns, moved = int(rolled[0][0]), rolled[1]
    t_s = (rolled[0] - origin_ns) / 1e9
    if not np.isfinite(moved).all() or not np.isfinite(gyro.value).all():
        raise LogError(f"log {path} holds samples that are not numbers: it is damaged, record it again")
    grid_s = np.arange(t_s[0], t_s[-1], TURNS.grid_s)
    rate_rad_s: Array = CubicSpline(t_s, moved[:, 2])(grid_s, 1)
    age_s = config.device_roles().wheel_age_s
    turns = Turns(
        path=path,
        wheel_age_s=age_s or 0.0,
        grid_s=grid_s,
        wheel_rate_rad_s=rate_rad_s,
        gyro_s=(gyro.t_ns - origin_ns) / 1e9,
        gyro_rad_s=gyro.value,
        blocks=_blocks(t_s, moved, grid_s, rate_rad_s),
        rates_ratio=abs(config.loop.rate_hz * float(np.median(np.diff(gyro.t_ns))) / 1e9 - 1.0),
    )
    if len(turns.blocks) < TURNS.least_blocks:
        raise LogError(
            f"log {path}: the rover turned in place for {len(turns.blocks) * TURNS.block_s:.0f} s, "
            f"{TURNS.least_blocks * TURNS.block_s:.0f} s are needed: "
            "let `calibrate imu` drive, or use a log of it"
        )
    return turns


def _blocks(t_s: Array, moved: Array, grid_s: Array, rate_rad_s: Array) -> Array:
    starts = np.arange(t_s[0] + TURNS.block_s, t_s[-1] - 2.0 * TURNS.block_s, TURNS.block_s)
    used = []
    for start_s in starts.tolist():
        inside = (t_s >= start_s) & (t_s <= start_s + TURNS.block_s)
        if inside.sum() < TURNS.least_readings or np.diff(t_s[inside]).max() > TURNS.longest_gap_s:
            continue
        way_m = float(np.hypot(*(moved[inside][-1, :2] - moved[inside][0, :2])))
        rates = rate_rad_s[(grid_s >= start_s) & (grid_s <= start_s + TURNS.block_s)]
        if way_m <= TURNS.in_place_m_s * TURNS.block_s and float(np.std(rates)) >= TURNS.least_rate_rad_s:
            used.append(start_s)
    return np.array(used)
