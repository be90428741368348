"""Effects that may be missing in the side-slope rover; their cards are in tables.toml."""

import math

from sim_backends.models.interface import Values
from sim_backends.models.side_slope.states import Build, Site, State

REFERENCE_MASS_KG = 23.8
USUAL_SLIP = 0.1


def flow_of_soil(values: Values, site: Site) -> tuple[float, float]:
    """Return the speed of the soil downhill and backward over r omega by `slope_failure`."""
    above = math.radians(max(site.slope_deg - values["onset"], 0.0))
    down = values["gain"] * above * (site.mass_kg / REFERENCE_MASS_KG) ** values["load_exponent"]
    return down, values["backward_share"] * down


def cog_shift_m(values: Values) -> tuple[float, float]:
    """Return the shift of the centre of gravity uphill and up by `cog_offset`."""
    direction = math.radians(values["direction"])
    return values["offset"] * math.cos(direction), values["offset"] * math.sin(direction)


def drift_rate_deg_m(values: Values, site: Site) -> float:
    """Return the turn of the rover uphill per metre by `heading_drift`."""
    steep = math.sin(math.radians(site.slope_deg)) / math.sin(math.radians(20.0))
    load = (site.mass_kg / REFERENCE_MASS_KG) ** values["load_exponent"]
    return float(values["rate"] * steep ** values["slope_exponent"] * load)


def dug_in(state: State, build: Build, values: Values) -> State:
    """Return a state with the sinkage that `slip_sinkage` adds beyond its part in the contact."""
    slip = max(1.0 - state.forward * build.radius_m / (build.radius_m + build.shearing_m), 0.0)
    deeper_m = values["depth_per_slip"] * USUAL_SLIP * (slip / USUAL_SLIP) ** values["exponent"]
    more_m = deeper_m - build.slip_sinkage_m * slip
    return state._replace(
        sinkage_up_m=state.sinkage_up_m + more_m, sinkage_down_m=state.sinkage_down_m + more_m
    )
