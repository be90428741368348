"""What slip compensation has changed in a run, how sure that is, and what it cost."""

from dataclasses import dataclass

import numpy as np

from rover_hil.drives.arrays import rms
from rover_hil.report.run_data import RunData

LEAST_ROLLED_M = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensation:
    """What slip compensation has changed.

    Attributes:
        moved_m: Distance of the estimate from the path that the wheels' travel gives with the estimated yaw,
            rms over the run: the error without compensation, where the estimate is right.
        sd_m: Standard deviation of the estimated position, rms over the run.
        further: By which share the wheels rolled farther than the rover moved by the estimate; at the same
            speed of the wheels the drive took as much longer.
    """

    moved_m: float
    sd_m: float
    further: float

    @property
    def words(self) -> str:
        """The same as a clause."""
        known = f"known to ± {1e3 * self.sd_m:.0f} mm"
        if self.moved_m <= self.sd_m:
            known += ", which is more than it has changed"
        if self.further <= 0.0:
            return f"{known}; the rover moved as far as the wheels rolled"
        return (
            f"{known}; the wheels rolled {100.0 * self.further:.0f} % farther than the rover moved, and the "
            "drive took as much longer"
        )


def compensation_of(run: RunData) -> Compensation | None:
    """Return what slip compensation has changed in a run.

    None without it, without a drive, and where positions have corrected the run: what they have changed
    cannot be separated from it.
    """
    if run.config.roles.fixes:
        return None
    if run.slip is None and run.drift is None and run.ground is None:
        return None
    rolled_m, moved_m = (float(track.distance_m()[-1]) for track in (run.encoders, run.estimate))
    if min(rolled_m, moved_m) < LEAST_ROLLED_M:
        return None
    estimate = run.estimate
    wheels = run.encoders.at(estimate.t_s)
    known = np.isfinite(wheels.x_m)
    steps_m = np.diff(wheels.x_m[known] + 1j * wheels.y_m[known])
    yaw_rad = (estimate.yaw_rad - wheels.yaw_rad)[known]
    turned_m = steps_m * np.exp(0.5j * (yaw_rad[1:] + yaw_rad[:-1]))
    places_m = (estimate.x_m + 1j * estimate.y_m)[known]
    without_m = places_m[0] + np.concatenate(([0.0], turned_m.cumsum()))
    variance_m2 = run.covariance[:, 0] + run.covariance[:, 3]
    return Compensation(
        moved_m=rms(np.abs(places_m - without_m)),
        sd_m=float(np.sqrt(np.mean(variance_m2))),
        further=rolled_m / moved_m - 1.0,
    )
