"""What is assumed about the ground, the section [ground]."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from controllers.estimation.slip_prior import FIRM, UNKNOWN, SlipPrior
from drivers.settings import Settings

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class GroundSettings(Settings):
    """What is assumed about slip that nothing measures: how much of the wheels' travel the rover loses.

    Attributes:
        slip: `unknown`: the rover may lose up to 60 % of the distance (two standard deviations). `firm`: the
            wheels roll on a hard, level floor, and their radii are calibrated: 1 %. `learned`: as measured on
            this ground, see the other keys; `rover-hil commission CONFIG --enter` writes it. A sensor that
            contradicts `firm` or `learned` while driving returns it to `unknown`.
        slip_mean: Mean share of the travel that is lost; only with `learned`.
        slip_sd: Standard deviation of this share; None for that of `slip`. `firm` has none of its own.
        cross_slip_sd: The same of the motion across the travel of the wheels, as a share of that.
        slip_distance_m: The correlation of the slip falls to 37 % over this distance.
        local_slip_sd: Standard deviation of the slip that changes over `filter.slip_distance_m`, in addition;
            as large as `slip_sd` where it is left out.
        noise_m_sqrt_m: Standard deviation of the position after one metre by what changes from wheel turn to
            wheel turn; only with `learned`, that of `firm` where it is left out.
        noise_m_sqrt_rad: The same after rotating by one radian; 0 where it is left out.
        source: The drives that `learned` comes from.
        learned_on: Day, as 2026-01-31.
    """

    slip: Literal["unknown", "firm", "learned"] = "unknown"
    slip_mean: Annotated[float, Field(ge=-0.5, le=0.95)] | None = None
    slip_sd: Share | None = None
    cross_slip_sd: Share | None = None
    slip_distance_m: Annotated[float, Field(ge=0.01, le=1000.0)] | None = None
    local_slip_sd: Share | None = None
    noise_m_sqrt_m: Share | None = None
    noise_m_sqrt_rad: Share | None = None
    source: str = ""
    learned_on: str = ""

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        numbers = {
            "slip_mean": self.slip_mean,
            "slip_sd": self.slip_sd,
            "cross_slip_sd": self.cross_slip_sd,
            "slip_distance_m": self.slip_distance_m,
            "local_slip_sd": self.local_slip_sd,
            "noise_m_sqrt_m": self.noise_m_sqrt_m,
            "noise_m_sqrt_rad": self.noise_m_sqrt_rad,
        }
        given = [key for key, value in numbers.items() if value is not None]
        if self.slip == "learned" and (self.slip_sd is None or not self.source):
            raise ValueError(
                'slip = "learned" needs slip_sd and source: run `rover-hil commission CONFIG --enter`, or '
                'set slip to "unknown"'
            )
        if self.slip == "firm" and given:
            raise ValueError(
                f'{", ".join(given)}: slip = "firm" has its own numbers; remove this, or set slip to '
                '"learned" with the source of the numbers'
            )
        for key in ("slip_mean", "noise_m_sqrt_m", "noise_m_sqrt_rad"):
            if self.slip == "unknown" and numbers[key] is not None:
                raise ValueError(f'{key}: slip = "unknown" has none; remove it, or set slip to "learned"')
        return self

    def prior(self) -> SlipPrior:
        """Return what is assumed at the start."""
        if self.slip == "firm":
            return FIRM
        prior = self.unknown()
        if self.slip_sd is None or self.slip == "unknown":
            return prior
        return prior._replace(
            name="learned",
            mean=self.slip_mean or 0.0,
            sd=self.slip_sd,
            cross_sd=self.slip_sd if self.cross_slip_sd is None else self.cross_slip_sd,
            local_sd=self.slip_sd if self.local_slip_sd is None else self.local_slip_sd,
            noise_m_sqrt_m=FIRM.noise_m_sqrt_m if self.noise_m_sqrt_m is None else self.noise_m_sqrt_m,
            noise_m_sqrt_rad=self.noise_m_sqrt_rad or 0.0,
        )

    def unknown(self) -> SlipPrior:
        """Return what is assumed where a sensor contradicts the assumption: the mean stays."""
        distance_m = UNKNOWN.distance_m if self.slip_distance_m is None else self.slip_distance_m
        if self.slip == "learned":
            return UNKNOWN._replace(mean=self.slip_mean or 0.0, distance_m=distance_m)
        return UNKNOWN._replace(
            sd=UNKNOWN.sd if self.slip_sd is None else self.slip_sd,
            cross_sd=UNKNOWN.cross_sd if self.cross_slip_sd is None else self.cross_slip_sd,
            distance_m=distance_m,
            local_sd=UNKNOWN.local_sd if self.local_slip_sd is None else self.local_slip_sd,
        )

    @property
    def words(self) -> str:
        """What is assumed and what it means, for messages and pages."""
        prior = self.prior()
        if self.slip == "learned":
            return (
                f"slip learned: {100 * prior.mean:.0f} % of the distance is lost, plus or minus "
                f"{200 * prior.sd:.0f} % (from {self.source})"
            )
        if self.slip == "firm":
            return f"firm ground: up to {200 * prior.sd:.0f} % of the distance may be lost"
        return _unknown_words(prior)

    @property
    def contradicted_words(self) -> str:
        """What counts after a sensor has contradicted the assumption, likewise."""
        return f'{_unknown_words(self.unknown())}, since a sensor has contradicted slip = "{self.slip}"'


def _unknown_words(prior: SlipPrior) -> str:
    return f"slip unknown: up to {min(100.0, 200 * prior.sd):.0f} % of the distance may be lost"
