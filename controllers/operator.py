"""What an operator may change while the rover runs: pause, stop, motion by hand, gains of the mission."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from annotated_types import Ge, Le

from controllers.motion.body_motion import BodyMotion
from controllers.motion.missions.mission import GAIN_UNITS, PathSettings
from controllers.settings import ControlSettings
from drivers.errors import ConfigError
from drivers.samples import PoseFixSample


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorInput:
    """What an operator wants from this cycle on.

    Attributes:
        is_paused: Whether the rover is to rest; None for no change.
        motion: Body velocity by hand: forward and to the left in m/s, counter-clockwise in rad/s; None for no
            new command.
        gains: New values of keys of [mission], by key.
        stop_reason: Why the operator's side must not let the rover move, e.g. because it is lost; "" where
            it may move again; None for no change.
        fixes: Poses measured from outside that arrived since the last cycle: samples of this one.
        is_confirmed: Whether the operator has just confirmed that the rover may move after a stop that
            requires it.
    """

    is_paused: bool | None = None
    motion: BodyMotion | None = None
    gains: Mapping[str, float] = field(default_factory=dict)
    stop_reason: str | None = None
    fixes: tuple[PoseFixSample, ...] = ()
    is_confirmed: bool = False


def merge(first: OperatorInput, then: OperatorInput) -> OperatorInput:
    """Return two inputs as one; of what both change, the later one counts."""
    return OperatorInput(
        is_paused=first.is_paused if then.is_paused is None else then.is_paused,
        motion=then.motion or first.motion,
        gains={**first.gains, **then.gains},
        stop_reason=first.stop_reason if then.stop_reason is None else then.stop_reason,
        fixes=first.fixes + then.fixes,
        is_confirmed=first.is_confirmed or then.is_confirmed,
    )


def gain_ranges(settings: ControlSettings) -> dict[str, tuple[float, float]]:
    """Return the least and greatest allowed value of each gain; empty for a mission that has none."""
    mission = settings.mission
    if mission is None:
        return {}
    ranges = {name: _field_range(name) for name in mission.gains()}
    if "speed_m_s" in ranges:
        low_m_s, high_m_s = ranges["speed_m_s"]
        stall_m_s = settings.safety.stall_set_point_rad_s * settings.rover.wheel_radius_m
        ranges["speed_m_s"] = (max(low_m_s, stall_m_s), high_m_s)
    return ranges


def check_gains(ranges: Mapping[str, tuple[float, float]], gains: Mapping[str, float]) -> None:
    """Check new gains.

    Raises:
        ConfigError: One is unknown, or outside its range.
    """
    for name, value in gains.items():
        if name not in ranges:
            known = ", ".join(ranges) or "none for this mission"
            raise ConfigError(f"mission.{name} cannot be changed while the rover runs, only: {known}")
        low, high = ranges[name]
        if not low <= value <= high:
            raise ConfigError(
                f"mission.{name} is {value:g}, outside {low:g} .. "
                f"{high:g} {GAIN_UNITS[name]}: the gain was not changed"
            )


def _field_range(name: str) -> tuple[float, float]:
    metadata = PathSettings.model_fields[name].metadata
    (low,) = (item.ge for item in metadata if isinstance(item, Ge) and isinstance(item.ge, int | float))
    (high,) = (item.le for item in metadata if isinstance(item, Le) and isinstance(item.le, int | float))
    return low, high
