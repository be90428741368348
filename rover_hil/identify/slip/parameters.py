"""Every tuned number of the identification of slip maps and of the yaw excitation's table.

Provenance, unless a line states another: chosen by hand, no record of the data. Units are in the names; other
numbers are ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.sensitivity slip`. Numbers of the motor and of the yaw
excitation that the rover uses, too, are in `controllers/slip/effort/parameters.py`.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowParameters:
    """Stretches of a run over which camera and wheels are compared."""

    least_readings: int = 4  # of the wheels, in a run
    least_run_readings: int = 3  # of the wheels, to check that currents were measured
    longest_gap_s: float = 0.15  # nothing is interpolated further away than this from a reading of a wheel
    length_s: float = 0.5
    least_length_s: float = 0.25  # of the last one of a run
    # With pose fixes: long enough for one fix every two seconds, short enough for slip to stay alike.
    longest_s: float = 2.5
    # Greatest standard deviation of a window's slip by the noise of its fixes: about as much as slip
    # scatters around the maps of the measured runs.
    slip_sd: float = 0.05
    # A fix further away than this share of the wheels' distance and so many standard deviations is wrong.
    jump_share: float = 1.5
    jump_sd: float = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraParameters:
    """Scale of a camera by runs on which the wheels roll."""

    calibrated_mm_per_px: float = (
        2.03  # fitted: 36 runs on the smooth table, BrOleg5/research-wheel-slippage @ b4303b4
    )
    least_runs: int = 3
    least_slip: float = 0.01  # an apparent slip below it is none
    least_speed_span_m_s: float = 0.05  # of runs that can show an effect of speed
    constant_share: float = 0.35  # effects below this share of the apparent slip leave it constant


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelParameters:
    """Maps of a wheel's slip."""

    tail: float = 0.005  # share of the values at each end that the valid range leaves out
    table_points: int = 25
    least_samples: int = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceParameters:
    """Curves of force, slip and drift over the direction of travel."""

    # Three wheels with rollers make patterns of 120 and 60 degrees; uneven wheel loads make the others.
    harmonics: int = 6
    # Weight of (order * amplitude)^2 against one window's squared error; cross-validated on training runs.
    ridge: float = 2.0
    start_s: float = 0.4  # left out at the start of a run: the rover still accelerates
    least_speed_m_s: float = 0.05
    least_speed_span_m_s: float = 0.05  # of runs that can show an effect of speed
    speed_tail: float = 0.05  # share of the speeds at each end that the range leaves out
    least_runs: int = 3  # a promise to users
    least_windows: int = 12  # of `least_runs` runs: twice the harmonics
    least_run_sd_n: float = 0.3  # of the force, from run to run
    least_window_sd_n: float = 0.1  # of the force, from window to window


@dataclass(frozen=True, slots=True, kw_only=True)
class HandParameters:
    """Positions that were measured by hand."""

    rest_s: float = 0.2  # the rover stands for this long about the time of a position
    rest_m: float = 0.002  # and its wheels travel less
    most_turn_rad: float = 0.2  # of the rover on a leg that is used
    straight_share: float = 0.95  # of such a leg: its chord over its way, by the wheels


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationParameters:
    """Cross-validation."""

    folds: int = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipFitParameters:
    """All tuned numbers, by their part of the method."""

    window: WindowParameters = WindowParameters()
    camera: CameraParameters = CameraParameters()
    wheel: WheelParameters = WheelParameters()
    surface: SurfaceParameters = SurfaceParameters()
    hand: HandParameters = HandParameters()
    validation: ValidationParameters = ValidationParameters()


SLIP_FIT = SlipFitParameters()
