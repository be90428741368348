"""Slip maps made by hand, so that the slip they must tell is known."""

import math
from datetime import date

from controllers.slip.effort.motor_model import MotorSettings
from controllers.slip.effort.slip_map import PolynomialMap, SlipMapFile
from controllers.slip.effort.surface_map import DirectionCurve, SurfaceMap, SurfaceModel

ALL_AROUND = tuple(math.radians(degrees) for degrees in range(-180, 180, 20))


def flat(value: float) -> DirectionCurve:
    return DirectionCurve(mean=value, cosines=(0.0,), sines=(0.0,))


def surface(name: str, force_n: float, slip: float, drift_rad: float = 0.0) -> SurfaceModel:
    return SurfaceModel(
        name=name,
        force_n=flat(force_n),
        slip=flat(slip),
        drift_rad=flat(drift_rad),
        force_window_sd_n=1.0,
        force_run_sd_n=0.3,
        speed_range_m_s=(0.1, 0.3),
    )


def make_maps(
    drift_rad: float = 0.0, directions_rad: tuple[float, ...] = ALL_AROUND, slip_per_a: float = 0.5
) -> SlipMapFile:
    """Return maps: a line slip = current / 2 A, a firm and a soft surface."""
    line = PolynomialMap(feature="current_a", valid_from=0.1, valid_to=1.5, coefficients=(0.0, slip_per_a))
    return SlipMapFile(
        source="by hand",
        fitted_on=date(2026, 1, 1),
        licence="none",
        motor=MotorSettings(current_full_scale_a=4.0),
        wheel_maps={"line": line},
        surface_wheel_maps={},
        surfaces=SurfaceMap(
            surfaces=(surface("firm", 5.0, 0.1, drift_rad), surface("soft", 25.0, 0.5, drift_rad)),
            directions_rad=directions_rad,
        ),
        cross_validation={},
    )
