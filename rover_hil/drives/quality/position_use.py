"""Positions of a drive that the estimate never used, and why."""

import cmath
from collections.abc import Sequence

import numpy as np

from controllers.control_loop import StepOutput
from controllers.estimation.positions.alignment import LEAST_SPREAD_SD
from drivers.samples import PoseFixSample


class PositionUse:
    """Counts position measurements that were given, and what became of them."""

    def __init__(self) -> None:
        self._places_m: list[complex] = []
        self._sds_m: list[float] = []
        self._devices: set[str] = set()
        self._used = 0

    def give(self, fixes: Sequence[PoseFixSample]) -> None:
        """Take measurements before they are given to the estimate."""
        for fix in fixes:
            self._devices.add(fix.device)
            place_m = complex(fix.x_m, fix.y_m)
            if cmath.isfinite(place_m) and fix.position_std_m > 0.0:
                self._places_m.append(place_m)
                self._sds_m.append(fix.position_std_m)

    def take(self, output: StepOutput) -> None:
        """Take what became of them in a cycle."""
        self._used += sum(
            1
            for innovation in output.innovations
            if innovation.measured.device in self._devices and innovation.accepted
        )

    def fault(self) -> str:
        """Return that none was used, why, and what helps; "" where one was, or there is none."""
        if self._used or not self._places_m:
            return ""
        weights = np.array(self._sds_m) ** -2
        places_m = np.array(self._places_m)
        spread = float(np.sum(weights * np.abs(places_m - np.average(places_m, weights=weights)) ** 2) ** 0.5)
        count = f"none of {len(places_m)} positions was used: "
        if spread < LEAST_SPREAD_SD:
            return (
                f"{count}they spread over {spread:.1f} of their standard deviations of "
                f"{np.median(self._sds_m):.2g} m, which does not show the direction of their axes "
                f"({LEAST_SPREAD_SD:g} do): give a yaw with them, a smaller sigma_m where they are better, "
                "or drive farther"
            )
        return (
            f"{count}they do not fit the path by the wheels in any direction, or were rejected: see the "
            "other findings, and check coordinates, times and wheels"
        )
