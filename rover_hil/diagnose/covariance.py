"""Whether the standard deviation of the estimate is honest, and which settings would be."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from controllers.estimation.ground_settings import GroundSettings
from rover_hil.config import Config
from rover_hil.diagnose.drive_errors import ESTIMATE, ODOMETRY, Compared, leg_m, travel_shares
from rover_hil.diagnose.replayed_drive import Replay, ReplayedDrive
from rover_hil.diagnose.trajectory_errors import pairs_by_distance, relative_errors
from rover_hil.drives.arrays import Array
from rover_hil.drives.quality.consistency import Consistency, consistency
from rover_hil.drives.quality.learned_ground import LearnedGround, ground_of

PERIOD_S = 0.5
"""Errors that are closer together are alike."""
FLOOR_M, FLOOR_RAD = 0.001, 0.002
"""Error of the ground truth and of its interpolation, at least."""
LEG_M = 1.0
BOUNDS = (1e-4, 1.0)
"""Of the settings of the yaw noise."""
BETTER = 0.8
"""Settings are better where the factor is nearer to 1 by so much, as a ratio of logarithms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Normalised:
    """Squared errors of the estimate of one drive over their covariance.

    Attributes:
        drive: Name of the drive.
        kind: Of its motion.
        t_s: Times, (n,).
        nees: (n,); expected is 3.
    """

    drive: str
    kind: str
    t_s: Array
    nees: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings whose standard deviations would be right.

    Attributes:
        ground: What was learned of the ground; None for too few legs.
        yaw_noise: Keys of [filter] and their values.
        before, after: Consistency on validation drives, which were not used for them; None without.
        validated_on: Names of these drives.
    """

    ground: LearnedGround | None
    yaw_noise: Mapping[str, float]
    before: Consistency | None
    after: Consistency | None
    validated_on: Sequence[str]

    @property
    def is_accepted(self) -> bool:
        """Whether the settings are better on validation drives, and not too small there."""
        if self.before is None or self.after is None or self.after.is_too_small:
            return False
        return abs(math.log(self.after.growth)) < BETTER * abs(math.log(self.before.growth))

    def applied(self, config: Config) -> Config:
        """Return a configuration with the settings."""
        changes: dict[str, object] = {
            "filter": config.filter.model_copy(update=dict(self.yaw_noise)),
        }
        if self.ground is not None:
            changes["ground"] = GroundSettings.model_validate(self.ground.settings("drives"))
        return config.model_copy(update=changes)


def normalised_errors(each: ReplayedDrive, replay: Replay, compared: Compared) -> Normalised | None:
    """Return the errors of an estimate over its covariance; None where that cannot be known.

    The ground truth needs a yaw, which ties the frames together at the start, and the estimate must not have
    used it.
    """
    true, own = compared.true, compared.tracks[ESTIMATE]
    true_rad, own_rad = true.yaw_rad, own.yaw_rad
    if each.truth is None or not each.is_independent or true_rad is None or own_rad is None:
        return None
    slots = np.floor(compared.t_s / PERIOD_S)
    use = np.flatnonzero(np.concatenate(([True], np.diff(slots) > 0.0)))
    first = use[0]
    turn_rad = own_rad[first] - true_rad[first]
    place_m = own.place_m[first] + (true.place_m[use] - true.place_m[first]) * np.exp(1j * turn_rad)
    errors_m = own.place_m[use] - place_m
    yaw_rad = own_rad[use] - true_rad[use] - turn_rad
    errors = np.column_stack((errors_m.real, errors_m.imag, np.angle(np.exp(1j * yaw_rad))))[1:]
    index = np.minimum(np.searchsorted(replay.t_s, compared.t_s[use[1:]]), len(replay.t_s) - 1)
    noise = np.diag([FLOOR_M**2 + 2.0 * each.truth.sd_m**2] * 2 + [2.0 * FLOOR_RAD**2])
    covariance = replay.covariance[index] + noise
    # The yaw of the first known pose is wrong, too: far away that moves the place.
    away = (true.place_m[use[1:]] - true.place_m[first]) * np.exp(1j * turn_rad)
    swing = np.column_stack((-away.imag, away.real, np.ones(len(away))))
    covariance = covariance + FLOOR_RAD**2 * swing[:, :, np.newaxis] * swing[:, np.newaxis, :]
    nees = np.einsum("ni,ni->n", errors, np.linalg.solve(covariance, errors[:, :, np.newaxis])[:, :, 0])
    return Normalised(drive=each.name, kind=each.kind, t_s=compared.t_s[use[1:]], nees=nees)


def judged(errors: Sequence[Normalised]) -> Consistency:
    """Return whether the covariance of some drives holds."""
    nees = [value for each in errors for value in each.nees.tolist()]
    return consistency(nees, [3] * len(nees), len(errors))


def by_kind(errors: Sequence[Normalised]) -> dict[str, Consistency]:
    """Return whether the covariance holds, by kind of motion."""
    kinds = dict.fromkeys(each.kind for each in errors)
    return {kind: judged([each for each in errors if each.kind == kind]) for kind in kinds}


def learned_settings(
    compared: Mapping[str, Compared],
    config: Config,
    validate: Callable[[Settings], tuple[Consistency, Consistency] | None],
    validation: Sequence[str],
) -> Settings:
    """Return the settings that drives show.

    Args:
        compared: Drives by name, their odometry by the wheels that are to be used.
        config: Of the rover.
        validate: Returns the consistency of the validation drives before and with settings.
        validation: Names of drives that are not used.
    """
    fitted = [each for name, each in compared.items() if name not in validation]
    shares = np.concatenate(
        [np.zeros(0, np.complex128), *(travel_shares(each, leg_m(fitted)) for each in fitted)]
    )
    noise = {} if config.roles.gyro is not None else wheel_yaw_noise(fitted)
    settings = Settings(
        ground=_in_range(ground_of(shares)),
        yaw_noise=noise,
        before=None,
        after=None,
        validated_on=tuple(validation),
    )
    found = validate(settings) if validation else None
    if found is None:
        return settings
    return Settings(
        ground=settings.ground,
        yaw_noise=noise,
        before=found[0],
        after=found[1],
        validated_on=tuple(validation),
    )


def _in_range(ground: LearnedGround | None) -> LearnedGround | None:
    """Return a ground that [ground] can state; None for another."""
    try:
        GroundSettings.model_validate({} if ground is None else ground.settings("drives"))
    except ValidationError:
        return None
    return ground


def wheel_yaw_noise(compared: Sequence[Compared]) -> dict[str, float]:
    """Return the noise of the wheels' yaw per angle and per metre; nothing without a true yaw.

    The squared yaw error of a leg of a metre is a share of its rotation and a share of its length: least
    squares without negative shares.
    """
    rows, squares = [], []
    for each in compared:
        wheels = each.tracks[ODOMETRY]
        pairs = pairs_by_distance(wheels, LEG_M)
        errors = relative_errors(wheels, each.true, pairs)
        if errors.yaw_rad is None or wheels.yaw_rad is None:
            continue
        turned = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(wheels.yaw_rad)))))
        rows += (turned[errors.end] - turned[errors.first]).tolist()
        squares += (errors.yaw_rad**2).tolist()
    if len(rows) < 2:
        return {}
    turned_rad, square = np.array(rows), np.array(squares)
    # One share where the other would be negative: the mean of the squares stays.
    per_rad, per_m = np.linalg.lstsq(np.column_stack((turned_rad, np.ones(len(rows)))), square, rcond=None)[0]
    if per_rad < 0.0:
        per_rad, per_m = 0.0, square.mean()
    elif per_m < 0.0:
        per_rad, per_m = square.sum() / max(turned_rad.sum(), 1e-9), 0.0
    values = {"wheel_yaw_noise_rad_sqrt_rad": per_rad, "wheel_yaw_noise_rad_sqrt_m": per_m / LEG_M}
    return {
        key: float(f"{min(max(math.sqrt(value), BOUNDS[0]), BOUNDS[1]):.2g}") for key, value in values.items()
    }
