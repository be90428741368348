"""Effects that the drives of every rover may have: lost encoder ticks and errors of the gyro."""

import numpy as np

from sim_backends.models.interface import Array, EffectCard, Parameter, Values, parameter


def encoder_dropouts(wheels: int, order: str, onset: Parameter, onsets: tuple[float, ...]) -> EffectCard:
    """Return the card of lost ticks; see `true_wheel_speed`.

    Args:
        wheels: Number of wheels.
        order: What the numbers of the wheels mean.
        onset: Wheel speed above which ticks are lost.
        onsets: Its values to search.
    """
    return EffectCard(
        name="encoder_dropouts",
        sentence="The counter of one wheel loses ticks, possibly only above some speed.",
        place="encoder of one wheel",
        parameters=(
            parameter("share", "1", 0.0, 0.05, 0.0, 0.9, "ticks lost above the onset"),
            parameter("wheel", "1", 1.0, 0.01, 1.0, float(wheels), order),
            onset,
        ),
        shape_grid={"wheel": tuple(float(wheel + 1) for wheel in range(wheels)), "onset": onsets},
        claims=("one wheel", "the wheel seems slower than it is, never faster", "none below the onset"),
        experiment="the wheel off the ground, slow and fast",
        source="interrupts missed by a counter, a broken wire",
    )


def true_wheel_speed(values: Values, wheel: int, counted_rad_s: Array) -> Array:
    """Return the speed of a wheel whose encoder counted `counted_rad_s`."""
    if round(values["wheel"]) != wheel or values["share"] <= 0.0:
        return counted_rad_s
    remaining = 1.0 - values["share"]
    return np.where(np.abs(counted_rad_s) > values["onset"], counted_rad_s / remaining, counted_rad_s)


def gyro_bias(unit: str, size: float, reach: float, releases: str | None = None) -> EffectCard:
    """Return the card of a constant rate that the gyro adds."""
    return EffectCard(
        name="gyro_bias",
        sentence="The gyro shows a rate at rest.",
        place="gyro",
        parameters=(parameter("rate", unit, 0.0, size, -reach, reach, "shown at rest"),),
        claims=("the same at every rate", "no other sensor shows it"),
        experiment="log at rest",
        source="micromechanical gyro",
        releases=releases,
    )


GYRO_SCALE = EffectCard(
    name="gyro_scale",
    sentence="The gyro shows too much or too little of every rate.",
    place="gyro",
    parameters=(parameter("error", "1", 0.0, 0.02, -0.5, 0.5, "shown over true rate, less one"),),
    claims=("in proportion to the rate, in both directions",),
    experiment="ten full turns",
    source="data sheets specify 1 to 3 %",
)
