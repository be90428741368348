"""The stop rules in force, and [safety]: their settings together. A new rule is registered here."""

from typing import Annotated

from pydantic import Field

from controllers.roles import DeviceRoles
from controllers.safety.area import AreaSettings
from controllers.safety.area_rule import AreaRule
from controllers.safety.dead_gyro_rule import DeadGyroRule
from controllers.safety.device_rules import BumperRule, BumperSettings, FaultRule, FreshnessRule, LinkRule
from controllers.safety.entrapment import EntrapmentRule, EntrapmentSettings
from controllers.safety.estimate_rules import (
    DifferentMotionRule,
    DisplacedFixRule,
    FiniteEstimateRule,
    FixJumpRule,
    MotionRule,
    UnseenMotionRule,
    UnseenSettings,
    YawDoubtRule,
    YawDoubtSettings,
)
from controllers.safety.flood_rule import FloodRule
from controllers.safety.frozen_position_rule import FrozenPositionRule
from controllers.safety.gyro_reading_rules import (
    GreatestRateRule,
    GyroJumpRule,
    GyroReadingSettings,
    GyroRestRule,
    StuckGyroRule,
)
from controllers.safety.gyro_sample_rate_rule import GyroSampleRateRule, GyroSampleRateSettings
from controllers.safety.gyro_turn_rules import (
    GyroDifferenceRule,
    GyroFollowsRule,
    GyroTurnSettings,
)
from controllers.safety.heading_rules import HeadingTurnRule, HeadingTurnSettings
from controllers.safety.innovation_monitor import InnovationMonitor, InnovationSettings
from controllers.safety.missed_turn_rule import MissedTurnRule
from controllers.safety.operator_rule import OperatorRule
from controllers.safety.reasons import StopRule
from controllers.safety.recorded_rules import StandingWheelsRule, ZeroReadingsRule
from controllers.safety.repetition_rule import RepetitionRule
from controllers.safety.response_rule import ResponseRule, ResponseSettings
from controllers.safety.source_check_rule import SourceCheckRule, SourceCheckSettings
from controllers.safety.stall_monitor import StallMonitor
from controllers.safety.steering_monitor import SteeringMonitor, SteeringReportRule, SteeringSettings
from controllers.safety.supply_rule import SupplyRule, SupplySettings
from controllers.safety.turn_comparison import TurnComparison
from controllers.safety.unproven_turn import UnprovenTurn


class SafetySettings(
    AreaSettings,
    BumperSettings,
    SupplySettings,
    InnovationSettings,
    ResponseSettings,
    SteeringSettings,
    GyroTurnSettings,
    GyroReadingSettings,
    GyroSampleRateSettings,
    HeadingTurnSettings,
    UnseenSettings,
    YawDoubtSettings,
    EntrapmentSettings,
    SourceCheckSettings,
):
    """When the rover stops, and when it moves again.

    Attributes:
        expiry_s: A command holds for this long after its cycle; if the loop hangs for longer, the watchdog
            stops the drive.
        settle_s: All required devices must be fresh for this long before the first motion.
        recover_s: And for this long before motion resumes after a stop.
        suspicion_rest_s: And for this long with the wheels at standstill after a stop that a healthy rover
            may show, too. Such a stop happens once: the second before `forget_stops_m`, or the third in a
            mission, lasts until restart, whatever their causes.
        identical_stops: The rover stays stopped until restart when it stops this many times for the same
            cause: driving may bring back a cause that cannot be seen at rest.
        forget_stops_m: Stops for a cause are forgotten after this distance without a sign of that cause.
    """

    expiry_s: Annotated[float, Field(ge=0.01, le=1.0)] = 0.15
    settle_s: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    recover_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.5
    suspicion_rest_s: Annotated[float, Field(ge=0.0, le=60.0)] = 2.0
    identical_stops: Annotated[int, Field(ge=1, le=100)] = 3
    forget_stops_m: Annotated[float, Field(ge=0.01, le=1000.0)] = 1.0


def make_rules(
    settings: SafetySettings, roles: DeviceRoles, wheel_count: int, heading_lag_s: float
) -> tuple[StopRule, ...]:
    """Return the rules in the order in which their reasons are reported: the likelier cause first.

    Without a gyro there is nothing to compare the headings with.
    """
    unproven = UnprovenTurn()
    return (
        BumperRule(settings),
        OperatorRule(),
        SourceCheckRule(),
        AreaRule(),
        LinkRule(roles),
        FaultRule(roles),
        SupplyRule(settings, roles),
        FreshnessRule(roles, wheel_count),
        SteeringReportRule(roles),
        FloodRule(roles),
        RepetitionRule(roles),
        FrozenPositionRule(roles),
        MotionRule(roles),
        FiniteEstimateRule(),
        GreatestRateRule(roles),
        StuckGyroRule(settings, roles),
        GyroJumpRule(settings, roles),
        GyroDifferenceRule(settings, roles),
        GyroFollowsRule(settings, roles, unproven),
        MissedTurnRule(settings, roles, unproven),
        DeadGyroRule(settings, roles, unproven),
        GyroRestRule(settings, roles),
        GyroSampleRateRule(settings, roles),
        *(() if roles.gyro is None else (HeadingTurnRule(settings, roles, heading_lag_s),)),
        InnovationMonitor(settings),
        DisplacedFixRule(settings),
        FixJumpRule(settings),
        DifferentMotionRule(),
        StallMonitor(settings, wheel_count),
        ResponseRule(settings, roles, wheel_count),
        EntrapmentRule(settings, roles),
        SteeringMonitor(settings),
        UnseenMotionRule(settings, roles),
        YawDoubtRule(settings, roles),
    )


def make_drive_rules(
    settings: SafetySettings, roles: DeviceRoles, wheel_count: int, heading_lag_s: float
) -> tuple[StopRule, ...]:
    """Return the rules for a drive that somebody else controls: those of a mission, and some of their own."""
    shared = make_rules(settings, roles, wheel_count, heading_lag_s)
    return (
        *(rule for rule in shared if rule.is_for_drives),
        StandingWheelsRule(),
        ZeroReadingsRule(roles),
        TurnComparison(roles),
    )
