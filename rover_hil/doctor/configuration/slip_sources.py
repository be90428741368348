"""Where a rover knows the slip of its wheels from, the best source first."""

from collections.abc import Iterator

from controllers.motion.kinematics import make_kinematics
from controllers.motion.steering import SteeringAngles
from controllers.slip.effort.settings import YAW_PROBE
from rover_hil.config import Config
from rover_hil.run.excitation import for_real_rover

LOOKS_LIKE_SLIP = (
    " (1 % of the camera's height or focal length is about 0.01 of slip; too long a focal length, or too "
    "low a height, looks like slip: "
    "only pose fixes or `rover-hil calibrate scale CONFIG` show it)"
)


def describe_slip_sources(config: Config) -> str:
    """Return the sources of slip of a rover without mistakes, in the order in which they are preferred.

    With ground motion also the error of the travel that the tolerance of the rig makes.
    """
    return ", then ".join(_sources(config))


def describe_ground(config: Config) -> str:
    """Return what is assumed about slip that nothing measures, and which sensors test that while driving."""
    words = config.ground.words
    if config.ground.slip == "unknown":
        return words
    testers = list(_testers(config))
    if not testers:
        return f"{words}; nothing on this rover can contradict this"
    sees_all = any(is_for_all for _, is_for_all in testers)
    alike = "" if sees_all else "; slip of all wheels alike on a straight path would not be noticed"
    return f"{words}, tested by {', '.join(name for name, _ in testers)}{alike}"


def _testers(config: Config) -> Iterator[tuple[str, bool]]:
    """Yield what may contradict the assumption, and whether it sees slip of all wheels alike."""
    if config.ground_motion is not None and config.roles.camera is not None:
        yield config.roles.camera, True
    for device in config.fix_sources:
        yield device, True
    slip = for_real_rover(config)[0].slip
    if slip is not None and slip.use == YAW_PROBE:
        yield "yaw excitation", True
    kinematics = make_kinematics(config.rover)
    if kinematics.skids_in_rotations:
        return
    if config.roles.gyro is not None:
        yield f"{config.roles.gyro} against the wheels in rotations", False
    straight_rad = SteeringAngles(kinematics.steering_rates_rad_s).angles_rad
    residuals = kinematics.residuals((0.0,) * kinematics.wheel_count, straight_rad)
    if residuals is not None and residuals.redundant:
        yield "the wheels against each other", False


def _sources(config: Config) -> Iterator[str]:
    camera = config.roles.camera
    if config.ground_motion is not None and camera is not None:
        is_calibrated = config.ground_motion.tolerance.scale_sd is not None
        yield (
            f"ground motion by {camera}, travel {_scale_percent(config):.1f} % uncertain by its rig"
            f"{'' if is_calibrated else LOOKS_LIKE_SLIP}"
        )
    if config.fix_sources:
        yield f"pose fixes by {' and '.join(config.fix_sources)}"
    if config.scomp is not None:
        has_trace = config.scomp.rig is not None and camera is not None
        yield f"slip law with the wheel trace by {camera}" if has_trace else "slip law by tilt"
    slip = config.slip
    if slip is not None and slip.use == YAW_PROBE:
        is_real = for_real_rover(config)[0].slip is not None
        yield "yaw excitation" if is_real else "yaw excitation (on the real rover after commissioning)"
    elif slip is not None:
        yield f"motor currents by {slip.use}"
    yield "encoders, which assume rolling wheels"


def _scale_percent(config: Config) -> float:
    # Imported here because they bring OpenCV, which a rover without a camera must not wait for.
    from controllers.ground_motion.flow import GroundFlow
    from controllers.ground_motion.ground_patch import GroundPatch
    from controllers.ground_motion.parameters import DEFAULTS
    from controllers.ground_motion.tolerance import scale_of

    ground = config.ground_motion
    assert ground is not None  # noqa: S101 - for the type checker
    patch = GroundPatch(ground.rig.geometry())
    return 100.0 * scale_of(patch, GroundFlow(patch, DEFAULTS.flow), ground.tolerance)[1]
