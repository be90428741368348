"""Does the torque correction oscillate? Gains and bounds on simulated sites, with the paper's map and a gyro.

    python -m benchmarks.robotino.torque_correction

Prints how often the busiest wheel's setpoint turns round per second, and how much setpoints change.
"""

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from controllers.safety import Mode
from rover_hil.config import Config, load_config
from rover_hil.tune.metrics import reversals_per_s
from rover_hil.tune.scenarios import with_scenario
from rover_hil.tune.simulated_mission import drive

SITES = (1, 3, 4)
REVERSAL_RAD_S = 0.5
CORRECTIONS: tuple[dict[str, object] | None, ...] = (
    None,
    {},
    {"gain_rad_s_nm": 4.0},
    {"gain_rad_s_nm": 50.0},
    {"gain_rad_s_nm": 50.0, "bound_rad_s": 5.0},
)


def judge(correction: dict[str, object] | None, site: int) -> str:
    """Drive once; return reversals per second and mean change of a setpoint in rad/s2."""
    table = load_config("robotino").model_dump(by_alias=True)
    table["slip"] |= {"use": "linear_m", "unknown_ground": "map", "torque_correction": correction}
    config = Config.model_validate(table)
    driven = drive(with_scenario(config, site))
    if driven.mode is not Mode.FINISHED:
        return "does not finish"
    period_s = 1.0 / config.loop.rate_hz
    reversals = reversals_per_s(driven.set_points_rad_s, period_s, REVERSAL_RAD_S)
    change_rad_s2 = np.abs(np.diff(driven.set_points_rad_s, axis=0)).mean() / period_s
    return f"{reversals:.2f} ({change_rad_s2:.1f})"


def main() -> None:
    """Print the table."""
    table = Table("site", *("without" if each is None else str(each) for each in CORRECTIONS))
    for site in track(SITES, console=Console(stderr=True), transient=True):
        table.add_row(str(site), *(judge(correction, site) for correction in CORRECTIONS))
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
