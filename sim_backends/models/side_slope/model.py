"""The rover of paper 001 that traverses a sand slope, with the effects that may be missing in it.

Base: the steady states of the paper's section IV.B with the numbers of its Tables I and III. Their priors are
the accuracy of plate, shear and wheel tests in the same sand. The path is measured in the frame of the slope,
so heading, flowing soil and a turned camera are applied after the steady state.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sim_backends.models.interface import Array, Channel, EffectCard, Parameter, Run, Values
from sim_backends.models.nominal_values import NominalValues
from sim_backends.models.side_slope.effects import cog_shift_m, drift_rate_deg_m, dug_in, flow_of_soil
from sim_backends.models.side_slope.states import Build, Site, SlopeStates, State
from sim_backends.models.tables import read_tables

DISTANCE_M = 1.0
START_SHARE = 0.3
"""Share of the distance that counts as start."""
MIDDLE_M = DISTANCE_M * (1.0 + START_SHARE) / 2.0
"""Distance at which a steady turn has its mean."""
BEND = "path_bend_deg_m"

CHANNELS = (
    Channel(name="slip", unit="1", tolerance=0.001, is_optional=True),
    Channel(name="slip_angle_deg", unit="deg", tolerance=0.05, is_optional=True),
    Channel(name="sinkage_up_mm", unit="mm", tolerance=0.1, is_optional=True),
    Channel(name="sinkage_down_mm", unit="mm", tolerance=0.1, is_optional=True),
    Channel(name="torque_up_Nm", unit="N m", tolerance=0.01, is_optional=True),
    Channel(name="torque_down_Nm", unit="N m", tolerance=0.02, is_optional=True),
    Channel(name=BEND, unit="deg/m", tolerance=0.1, is_optional=True),
)

PARAMETERS, EFFECTS = read_tables(__file__)
NOMINAL_RADIUS_M = next(item.nominal for item in PARAMETERS if item.name == "wheel_radius_m")
"""Radius with which encoder speeds were turned into r omega."""
LATE_DISTANCE_M = np.linspace(START_SHARE * DISTANCE_M, DISTANCE_M, 36)
NOMINAL = NominalValues(PARAMETERS, EFFECTS)


class _Seen(NamedTuple):
    """Changes of the measured path after the steady state.

    Attributes:
        flow_down: Downhill speed of the failing soil, over r omega.
        flow_back: Its speed backward.
        creep_deg: Turn of the path uphill without a turn of the body.
        camera_yaw_deg: Turn of the measured path, uphill.
        camera_slip_share: Share of that which enters the speed along the traverse.
        late: Mean of slip and side speed after the start, over their steady values.
    """

    flow_down: float
    flow_back: float
    creep_deg: float
    camera_yaw_deg: float
    camera_slip_share: float
    late: float


class SideSlope:
    """A `Model` of a four-wheeled rover on a side slope."""

    name = "side-slope"
    channels: tuple[Channel, ...] = CHANNELS
    condition_units: Mapping[str, str] = {"slope_deg": "deg", "roll_deg": "deg", "mass_kg": "kg"}
    parameters: tuple[Parameter, ...] = PARAMETERS
    effects: tuple[EffectCard, ...] = EFFECTS

    def __init__(self) -> None:
        self._states = SlopeStates()

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict every channel of every run; NaN where no steady state exists. See `Model.predict`."""
        base, active = NOMINAL.fill(parameters, effects)
        build = _build(base, active)
        tables: list[dict[str, Array]] = []
        for run in runs:
            site = Site(*(float(run.conditions[name]) for name in self.condition_units))
            tables.append(self._table(build, site, base, active))
        return tables

    def _table(
        self, build: Build, site: Site, base: Values, active: Mapping[str, Values]
    ) -> dict[str, Array]:
        drift = active["heading_drift"]
        seen = _seen(base, active, site)
        state = self._states.state(build, site)
        path = _path(state, build, seen)
        bend = path[1] * late_bend(base["start_length_m"])
        turn = drift_rate_deg_m(drift, site) * MIDDLE_M
        if turn != 0.0:
            body = drift["body_share"] * turn
            turned = build._replace(heading_deg=build.heading_deg + body)
            if body != 0.0:
                state = self._states.state(turned, site)
            straight = path[1]
            path = _path(state, turned, seen._replace(creep_deg=seen.creep_deg + turn - body))
            bend += (path[1] - straight) / MIDDLE_M
        return _measured(dug_in(state, build, active["slip_sinkage"]), path, bend, base)


def _build(base: Values, active: Mapping[str, Values]) -> Build:
    heading = active["heading_offset"]
    lateral_m, height_m = cog_shift_m(active["cog_offset"])
    return Build(
        friction_angle_deg=base["friction_angle_deg"] + active["friction_angle"]["change"],
        shear_modulus_m=base["shear_modulus_m"] + active["shear_modulus"]["change"],
        k_phi=base["sinkage_modulus"] + active["sinkage_modulus"]["change"],
        exponent=base["sinkage_exponent"],
        exit_share=base["exit_share"],
        greatest_stress=base["greatest_stress"],
        wall_friction_deg=active["sidewall"]["wall_friction"],
        radius_m=base["wheel_radius_m"] + active["wheel_radius"]["change"],
        shearing_m=active["grouser_radius"]["excess"],
        slip_sinkage_m=active["slip_sinkage"]["depth_per_slip"] * active["slip_sinkage"]["contact_share"],
        cog_lateral_m=base["cog_lateral_m"] + lateral_m,
        cog_height_m=base["cog_height_m"] + height_m,
        heading_deg=base["heading_deg"] + heading["offset"] * heading["body_share"],
    )


def _seen(base: Values, active: Mapping[str, Values], site: Site) -> _Seen:
    heading, camera = active["heading_offset"], active["camera_yaw"]
    down, back = flow_of_soil(active["slope_failure"], site)
    return _Seen(
        flow_down=down,
        flow_back=back,
        creep_deg=heading["offset"] * (1.0 - heading["body_share"]),
        camera_yaw_deg=base["camera_yaw_deg"] + camera["offset"],
        camera_slip_share=camera["slip_share"],
        late=late_mean(base["start_length_m"]),
    )


def late_mean(length_m: float) -> float:
    """Return the mean of 1 - exp(-x / length) after the start."""
    return float(np.mean(1.0 - np.exp(-LATE_DISTANCE_M / length_m)))


def late_bend(length_m: float) -> float:
    """Return the slope per metre of a straight line through 1 - exp(-x / length) after the start."""
    offset = LATE_DISTANCE_M - LATE_DISTANCE_M.mean()
    return float(offset @ -np.exp(-LATE_DISTANCE_M / length_m) / (offset @ offset))


def _path(state: State, build: Build, seen: _Seen) -> tuple[float, float]:
    """Return slip and slip angle (deg) as measured by the camera in the frame of the slope."""
    heading, yaw = math.radians(build.heading_deg), math.radians(seen.camera_yaw_deg)
    forward = 1.0 - (1.0 - state.forward) * seen.late
    sideways = state.sideways * seen.late + forward * math.tan(math.radians(seen.creep_deg))
    along = forward * math.cos(heading) - sideways * math.sin(heading) - seen.flow_back
    across = forward * math.sin(heading) + sideways * math.cos(heading) - seen.flow_down
    entering = yaw * seen.camera_slip_share
    seen_along = along * math.cos(entering) - across * math.sin(entering)
    slip = 1.0 - seen_along * build.radius_m / NOMINAL_RADIUS_M
    return slip, math.degrees(math.atan2(across, along) + yaw)


def _measured(state: State, path: tuple[float, float], bend: float, base: Values) -> dict[str, Array]:
    scale, zero = base["torque_scale"], base["sinkage_zero_mm"]
    values = {
        "slip": path[0],
        "slip_angle_deg": path[1],
        "sinkage_up_mm": 1000.0 * state.sinkage_up_m + zero,
        "sinkage_down_mm": 1000.0 * state.sinkage_down_m + zero,
        "torque_up_Nm": scale * state.torque_up_nm,
        "torque_down_Nm": scale * state.torque_down_nm,
        BEND: bend,
    }
    return {name: np.array([value]) for name, value in values.items()}


def make_model() -> SideSlope:
    """Return the model with its effects."""
    return SideSlope()
