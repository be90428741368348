"""What notices that a rover does not get on although its wheels turn."""

from collections.abc import Iterator

from controllers.slip.effort.settings import YAW_PROBE
from rover_hil.config import Config
from rover_hil.run.excitation import for_real_rover


def describe_progress(config: Config) -> str:
    """Return what a rover notices of wheels in the air, digging in, a wall and a stuck wheel."""
    sources = list(_sources(config))
    if not sources:
        sources = ["nothing notices wheels in the air, a rover that has dug in, or a wall"]
    stall_s = config.safety.stall_s
    return "; ".join([*sources, f"a wheel that sticks stops it after {stall_s:g} s, by its encoder"])


def _sources(config: Config) -> Iterator[str]:
    safety, camera = config.safety, config.roles.camera
    if config.ground_motion is not None and camera is not None:
        yield f"{camera} shows no progress: stopped after {safety.entrapment_ground_m:g} m of the wheels"
    if config.fix_sources:
        devices = " and ".join(config.fix_sources)
        yield f"{devices} show no progress: stopped after {safety.entrapment_m:g} m and a period of the fixes"
    unknown = f"stopped once after {safety.progress_unknown_m:g} m"
    slip = config.slip
    if slip is not None and slip.use == YAW_PROBE:
        is_real = for_real_rover(config)[0].slip is not None
        name = "yaw excitation" if is_real else "yaw excitation, on the real rover after commissioning"
        yield f"wheels in the air and digging in by the {name}: {unknown}"
    if slip is not None:
        what = "wheels in the air, digging in and a wall"
        yield f"{what} by the currents, where they are far from those of free driving: {unknown}"
    if config.scomp is not None and config.scomp.rig is not None and camera is not None:
        after = f"stopped once after {safety.entrapment_m:g} m"
        yield f"{camera} sees no motion of the ground, or is covered: {after}"
