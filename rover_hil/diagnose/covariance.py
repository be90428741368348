"""Whether the standard deviation of the estimate is honest, and which settings would be."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import ValidationError

from controllers.estimation.ground_settings import GroundSettings
from rover_hil.config import Config
from rover_hil.diagnose.drive_errors import ESTIMATE, Compared, leg_m, travel_shares
from rover_hil.diagnose.error_growth import error_growth
from rover_hil.diagnose.replayed_drive import Replay, ReplayedDrive
from rover_hil.drives.arrays import Array
from rover_hil.drives.quality.consistency import Consistency, consistency
from rover_hil.drives.quality.drive_paths import DrivePath
from rover_hil.drives.quality.learned_ground import LearnedGround, ground_of

PERIOD_S = 0.5
"""Errors that are closer together are alike."""
FLOOR_M, FLOOR_RAD = 0.001, 0.002
"""Error of the ground truth and of its interpolation, at least."""
NORMAL_MEDIAN = 0.6745
"""Median of the size of a normal error, over its standard deviation."""
LEAST_SLIP = 1e-4
"""No ground is known better; the settings have four decimals."""
BOUNDS = (1e-4, 1.0)
"""Of the settings of the yaw noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Normalised:
    """Squared errors of the estimate of one drive over their covariance.

    Attributes:
        drive: Name of the drive.
        kind: Of its motion.
        t_s: Times, (n,).
        nees: (n,); expected is 3.
        surprise: Minus twice the logarithm of the likelihood of each error, but for a constant, (n,).
    """

    drive: str
    kind: str
    t_s: Array
    nees: Array
    surprise: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings whose standard deviations would be right.

    Attributes:
        ground: What was learned of the ground; None for too few legs.
        yaw_noise: Keys of [filter] and their values.
        before, after: Consistency on validation drives, the latter by settings of the other drives alone;
            None without.
        gain: By how much the mean surprise of an error there is smaller with the settings.
        validated_on: Names of these drives.
    """

    ground: LearnedGround | None
    yaw_noise: Mapping[str, float]
    before: Consistency | None
    after: Consistency | None
    gain: float
    validated_on: Sequence[str]

    @property
    def is_accepted(self) -> bool:
        """Whether the errors of validation drives are likelier with the settings, which are not too small."""
        return self.after is not None and not self.after.is_too_small and self.gain > 0.0

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
    known_m, known_rad = _noise_of_truth(each.truth)
    noise = np.diag([2.0 * known_m**2] * 2 + [2.0 * known_rad**2])
    covariance = replay.covariance[index] + noise
    # The yaw of the first known pose is wrong, too: far away that moves the place.
    away = (true.place_m[use[1:]] - true.place_m[first]) * np.exp(1j * turn_rad)
    swing = np.column_stack((-away.imag, away.real, np.ones(len(away))))
    covariance = covariance + known_rad**2 * swing[:, :, np.newaxis] * swing[:, np.newaxis, :]
    nees = np.einsum("ni,ni->n", errors, np.linalg.solve(covariance, errors[:, :, np.newaxis])[:, :, 0])
    return Normalised(
        drive=each.name,
        kind=each.kind,
        t_s=compared.t_s[use[1:]],
        nees=nees,
        surprise=nees + np.linalg.slogdet(covariance)[1],
    )


def _noise_of_truth(truth: DrivePath) -> tuple[float, float]:
    """Return the standard deviations of a known place and yaw, at least those by their jitter."""
    assert truth.yaw_rad is not None  # noqa: S101 the caller has checked it
    jitter_m = math.sqrt(0.5) * math.hypot(_jitter(truth.x_m), _jitter(truth.y_m))
    return max(FLOOR_M, truth.sd_m, jitter_m), max(FLOOR_RAD, _jitter(truth.yaw_rad))


def _jitter(values: Array) -> float:
    """Return the standard deviation of independent errors of a smooth course, by its second differences."""
    return float(np.median(np.abs(np.diff(values, 2)))) / (NORMAL_MEDIAN * math.sqrt(6.0))


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
    validate: Callable[[Settings], tuple[Sequence[Normalised], Sequence[Normalised]]],
    validation: Sequence[str],
) -> Settings:
    """Return the settings that drives show.

    Args:
        compared: Drives by name, their odometry by the wheels that are to be used.
        config: Of the rover.
        validate: Returns the errors of the validation drives before and with settings.
        validation: Names of drives that are not used.
    """
    has_gyro = config.roles.gyro is not None
    settings = _of_drives([each for name, each in compared.items() if name not in validation], has_gyro)
    before, after = validate(settings) if validation else ((), ())
    if not after:
        return settings
    # They have been tried: more drives make them more certain.
    return replace(
        _of_drives(list(compared.values()), has_gyro),
        before=judged(before),
        after=judged(after),
        gain=_surprise(before) - _surprise(after),
        validated_on=tuple(validation),
    )


def _surprise(errors: Sequence[Normalised]) -> float:
    return float(np.mean([each.surprise.mean() for each in errors]))


def _of_drives(fitted: Sequence[Compared], has_gyro: bool) -> Settings:
    """Return the settings that drives show, not validated."""
    shares = np.concatenate(
        [np.zeros(0, np.complex128), *(travel_shares(each, leg_m(fitted)) for each in fitted)]
    )
    ground, noise = ground_of(shares), dict[str, float]()
    if not has_gyro:
        ground, noise = _by_growth(fitted, ground)
    return Settings(
        ground=_in_range(ground), yaw_noise=noise, before=None, after=None, gain=0.0, validated_on=()
    )


def _by_growth(
    fitted: Sequence[Compared], ground: LearnedGround | None
) -> tuple[LearnedGround | None, dict[str, float]]:
    """Return the ground and the noise of the yaw by how the errors of the wheels grow."""
    growth = error_growth(fitted, 0.0 if ground is None else ground.mean)
    if growth is None:
        return ground, {}
    noise = {
        "wheel_yaw_noise_rad_sqrt_rad": growth.yaw_rad_sqrt_rad,
        "wheel_yaw_noise_rad_sqrt_m": growth.yaw_rad_sqrt_m,
    }
    if ground is not None:
        ground = ground._replace(
            sd=max(growth.slip, LEAST_SLIP),
            cross_sd=growth.cross_slip,
            noise_m=(growth.place_m_sqrt_m, growth.place_m_sqrt_rad),
        )
    return ground, {
        key: float(f"{min(max(value, BOUNDS[0]), BOUNDS[1]):.2g}") for key, value in noise.items()
    }


def _in_range(ground: LearnedGround | None) -> LearnedGround | None:
    """Return a ground that [ground] can state; None for another."""
    try:
        GroundSettings.model_validate({} if ground is None else ground.settings("drives"))
    except ValidationError:
        return None
    return ground
