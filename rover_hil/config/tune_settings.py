"""Settings of tuning, [tune]. Cheap to import: every configuration may have it."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Settings

Reference = Annotated[float, Field(gt=0)]
MOST_CASES = 1000


class TunableSettings(Settings):
    """The range of one gain or filter parameter.

    Attributes:
        low: Smallest value tried, in the unit of the key.
        high: Greatest value tried, in the unit of the key.
        scale: `log` where a factor matters rather than a difference; `low` must then be positive.
        unit: Unit of the key, for reports.
    """

    low: float
    high: float
    scale: Literal["linear", "log"] = "linear"
    unit: Annotated[str, Field(min_length=1)]

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.low >= self.high:
            raise ValueError(f"low {self.low:g} is not below high {self.high:g}: swap or widen them")
        if self.scale == "log" and self.low <= 0.0:
            raise ValueError(
                f"low {self.low:g} must be positive on a log scale: raise it or write scale = 'linear'"
            )
        return self


class ObjectiveSettings(Settings):
    """The cost that is minimised: the sum of every measured value divided by its reference here.

    A term without a reference does not count. A quantile over all cases counts, so that a good mean cannot
    hide bad scenarios.

    Attributes:
        path_rms_m: Reference of the distance between true and commanded path, root mean square.
        closure_m: Reference of the distance between the true end and the commanded one.
        heading_deg: Reference of the true heading error along the path.
        effort_rad_s2: Reference of the setpoints' acceleration, root mean square.
        duration_s: Reference of the time that the mission takes.
        quantile: Quantile of the costs of all cases that counts, 0.5 (median) to 1 (worst).
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
            raise ValueError("has no term: add path_rms_m, closure_m, heading_deg or effort_rad_s2")
        return self

    def references(self) -> dict[str, float]:
        """Return the terms that count, by name, with their references."""
        values = self.model_dump(exclude={"quantile"}, exclude_none=True)
        return {name: float(value) for name, value in values.items()}


class LogObjectiveSettings(Settings):
    """The cost of values that are judged by logs: the sum of every measured value divided by its reference.

    A term without a reference does not count. All terms are pooled over the logs.

    Attributes:
        position_m: Reference of the error of the estimated position, root mean square.
        heading_deg: Reference of the error of the estimated heading, root mean square.
        nees: Reference of the absolute logarithm of the mean NEES over its dimension, the mean of position
            and yaw: 0 where the covariance is right, 0.7 where it is wrong by a factor of two.
        nis: The same for the innovations of each kind of measurement, by their median; the mean of all kinds.
        whiteness: Reference of the correlation of successive innovations, the mean of all kinds; 0 is white.
    """

    position_m: Reference | None = None
    heading_deg: Reference | None = None
    nees: Reference | None = None
    nis: Reference | None = None
    whiteness: Reference | None = None

    @model_validator(mode="after")
    def _check_terms(self) -> Self:
        if not self.references():
            raise ValueError("has no term: add position_m, heading_deg, nees, nis or whiteness")
        return self

    def references(self) -> dict[str, float]:
        """Return the terms that count, by name, with their references."""
        return {name: float(value) for name, value in self.model_dump(exclude_none=True).items()}


class LogTuneSettings(Settings):
    """What `tune logs` may change, and what it minimises.

    Attributes:
        parameters: Ranges by dotted key, of [filter], [slip] and [scomp], e.g. "filter.heading_noise_rad".
        objective: The cost that is minimised.
        withheld_s: Where pose fixes are the only truth, the filter gets one in this time, and is judged by
            how far its prediction is from that one.
    """

    parameters: Annotated[dict[str, TunableSettings], Field(min_length=1)]
    objective: LogObjectiveSettings = LogObjectiveSettings(
        position_m=0.05, heading_deg=3, nees=0.7, nis=0.7, whiteness=0.5
    )
    withheld_s: Annotated[float, Field(ge=0.1, le=600.0)] = 5.0


class StabilitySettings(Settings):
    """Which gains are rejected as oscillating, at any cost; unfinished missions are always rejected.

    Attributes:
        reversal_rad_s: A wheel setpoint has reversed when it goes back by this much.
        reversals_per_s: Largest accepted rate of reversals of one wheel, over four seconds. A corner takes
            two or three.
    """

    reversal_rad_s: Annotated[float, Field(gt=0, le=50)] = 0.5
    reversals_per_s: Annotated[float, Field(gt=0, le=50)] = 1.5


class CaseSettings(Settings):
    """Number of simulated scenarios; each has a seed of its own for all noise.

    Attributes:
        train: Number of scenarios that the search uses.
        ranking: Number of further scenarios that decide which of the five best trials is taken: the best of
            many trials was also lucky with the scenarios of the search.
        held_out: Number of scenarios on which old and new gains are compared. The three have no seed in
            common.
    """

    train: Annotated[int, Field(ge=1, le=MOST_CASES)] = 12
    ranking: Annotated[int, Field(ge=1, le=MOST_CASES)] = 24
    held_out: Annotated[int, Field(ge=1, le=MOST_CASES)] = 24


class ChangeRecord(Settings):
    """The change of one parameter by tuning.

    Attributes:
        before: Value before tuning.
        after: Value after tuning.
        unit: Unit of the value.
    """

    before: float
    after: float
    unit: str


class ProvenanceRecord(Settings):
    """Where tuned values come from; written by `rover-hil tune`, kept in every log.

    Attributes:
        study: Name of the study.
        date: Local time, as 20260102-030405.
        start: The configuration that the study started from.
        trials: Number of sets of values tried.
        objective: The cost in words.
        train_seeds, ranking_seeds, held_out_seeds: First and last seed; none where logs were replayed, and no
            `ranking_seeds` in older files.
        train_logs, held_out_logs: Names of the logs; none where missions were simulated.
        drives: Names of the recorded drives whose intervals the scenarios were drawn from; none without.
        held_out_cost_before: Cost on the held-out cases before tuning; none where the start was rejected.
        held_out_cost_after: Cost on the held-out cases after tuning.
        changes: Changes by dotted key; empty when the start was best.
    """

    study: str
    date: str
    start: str
    trials: int
    objective: str
    train_seeds: tuple[int, int] | None = None
    ranking_seeds: tuple[int, int] | None = None
    held_out_seeds: tuple[int, int] | None = None
    train_logs: tuple[str, ...] | None = None
    held_out_logs: tuple[str, ...] | None = None
    drives: tuple[str, ...] | None = None
    held_out_cost_before: float | None = None
    held_out_cost_after: float
    changes: dict[str, ChangeRecord] = Field(default_factory=dict)


class TuneSettings(Settings):
    """What `rover-hil tune` may change, and what it minimises.

    Attributes:
        parameters: Ranges by dotted key, e.g. "mission.lookahead_m"; none to tune by logs only.
        objective: The cost that is minimised.
        stability: Which gains are rejected as oscillating.
        cases: Number of simulated scenarios.
        at_once: Number of trials that are proposed together. The result of a study depends on it, but not on
            the number of workers; with more workers than `at_once * cases.train` some have no work.
        seed: Of the search. Another seed gives another study.
        logs: What is tuned by replay of logs, without simulation; none for no such parameters.
        provenance: Where the values come from; written by `rover-hil tune`.
    """

    parameters: dict[str, TunableSettings] = Field(default_factory=dict)
    objective: ObjectiveSettings = ObjectiveSettings(path_rms_m=0.05, closure_m=0.1, heading_deg=3)
    stability: StabilitySettings = StabilitySettings()
    cases: CaseSettings = CaseSettings()
    at_once: Annotated[int, Field(ge=1, le=1000)] = 8
    seed: Annotated[int, Field(ge=0, le=4000)] = 0
    logs: LogTuneSettings | None = None
    provenance: ProvenanceRecord | None = None
