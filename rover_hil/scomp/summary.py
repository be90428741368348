"""The numbers of an estimated path."""

import numpy as np

from rover_hil.scomp.odometry import Result


def summary_of(result: Result) -> dict[str, float]:
    """Return end, uncertainty and distance of a path, and the mean NIS of each sensor.

    A consistent filter has a mean NIS near 1; rejected readings do not count.
    """
    track = result.track
    summary = {
        "x_m": float(track.x_m[-1]),
        "y_m": float(track.y_m[-1]),
        "heading_rad": float(track.heading_rad[-1]),
        "sigma_x_m": float(track.sigma_x_m[-1]),
        "sigma_y_m": float(track.sigma_y_m[-1]),
        "way_m": float(np.hypot(np.diff(track.x_m), np.diff(track.y_m)).sum()),
        "mean_slip": float(np.mean(track.slip)),
        "refused": float(sum(not innovation.accepted for innovation in result.innovations)),
    }
    for name in sorted({innovation.name for innovation in result.innovations}):
        nis = [i.nis for i in result.innovations if i.name == name and i.accepted and i.nis is not None]
        if nis:
            summary[f"nis_{name.replace(' ', '_')}"] = float(np.mean(nis))
    return summary
