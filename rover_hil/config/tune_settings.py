"""What the configuration says about tuning: [tune]. Cheap to import: every configuration may have it."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Settings

Reference = Annotated[float, Field(gt=0)]
MOST_CASES = 1000


class TunableSettings(Settings):
    """The range of one gain or filter parameter.

    Attributes:
        low: Smallest value tried, in the unit of the key.
        high: Greatest value tried.
        scale: `log` where a factor matters rather than a difference; `low` must then be positive.
        unit: For people to read.
    """

    low: float
    high: float
    scale: Literal["linear", "log"] = "linear"
    unit: Annotated[str, Field(min_length=1)]

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.low >= self.high:
            msg = f"low {self.low:g} is not below high {self.high:g}: swap or widen them"
            raise ValueError(msg)
        if self.scale == "log" and self.low <= 0.0:
            msg = f"low {self.low:g} must be positive on a log scale: raise it or say scale = 'linear'"
            raise ValueError(msg)
        return self


class ObjectiveSettings(Settings):
    """What is made small: the sum of every measured value divided by its reference here.

    A term left out does not count. Of all cases the given quantile counts, so that a good mean cannot hide
    bad sites.

    Attributes:
        path_rms_m: Reference of the distance between true and commanded path.
        closure_m: Reference of the distance between the true end and the commanded one.
        heading_deg: Reference of the true heading error along the way.
        effort_rad_s2: Reference of the set-points' acceleration, root mean square.
        duration_s: Reference of the time the mission takes.
        quantile: Which quantile of the cases' costs counts, 0.5 (median) to 1 (worst).
    """

    path_rms_m: Reference | None = None
    closure_m: Reference | None = None
    heading_deg: Reference | None = None
    effort_rad_s2: Reference | None = None
    duration_s: Reference | None = None
    quantile: Annotated[float, Field(ge=0.5, le=1.0)] = 0.9

    @model_validator(mode="after")
    def _check_terms(self) -> Self:
        if not self.references():
            msg = "names nothing to make small: add path_rms_m, closure_m, heading_deg or effort_rad_s2"
            raise ValueError(msg)
        return self

    def references(self) -> dict[str, float]:
        """Return the terms that count, by name, with their references."""
        values = self.model_dump(exclude={"quantile"}, exclude_none=True)
        return {name: float(value) for name, value in values.items()}


class StabilitySettings(Settings):
    """Which gains are refused, whatever their cost: unfinished missions always are, and oscillation.

    Attributes:
        reversal_rad_s: A wheel set-point turns round when it goes back by this much.
        reversals_per_s: Most turns of one wheel within four seconds, per second. A corner takes two or three.
    """

    reversal_rad_s: Annotated[float, Field(gt=0, le=50)] = 0.5
    reversals_per_s: Annotated[float, Field(gt=0, le=50)] = 1.5


class CaseSettings(Settings):
    """How many sites, each with a seed of its own for all noise.

    Attributes:
        train: The search sees these.
        held_out: Old and new gains are compared on these; they have no seed in common with `train`.
    """

    train: Annotated[int, Field(ge=1, le=MOST_CASES)] = 12
    held_out: Annotated[int, Field(ge=1, le=MOST_CASES)] = 24


class ChangeRecord(Settings):
    """What tuning made of one parameter."""

    before: float
    after: float
    unit: str


class ProvenanceRecord(Settings):
    """Where tuned values come from; written by `rover-hil tune`, kept in every log.

    Attributes:
        study: Name of the study.
        date: Local time, as 20260102-030405.
        start: The configuration that it started from.
        trials: How many sets of values were tried.
        objective: What was made small, in words.
        train_seeds, held_out_seeds: First and last.
        held_out_cost_before, held_out_cost_after: On the held-out cases; before is None where the start was
            refused.
        changes: By dotted key; empty when the start was best.
    """

    study: str
    date: str
    start: str
    trials: int
    objective: str
    train_seeds: tuple[int, int]
    held_out_seeds: tuple[int, int]
    held_out_cost_before: float | None = None
    held_out_cost_after: float
    changes: dict[str, ChangeRecord] = Field(default_factory=dict)


class TuneSettings(Settings):
    """What may be tuned, and to what end.

    Attributes:
        parameters: Ranges by dotted key, e.g. "mission.lookahead_m".
        provenance: Present in configurations that came out of tuning.
    """

    parameters: Annotated[dict[str, TunableSettings], Field(min_length=1)]
    objective: ObjectiveSettings
    stability: StabilitySettings = StabilitySettings()
    cases: CaseSettings = CaseSettings()
    provenance: ProvenanceRecord | None = None
