"""Impossible numbers in a model are refused where they are declared, with object, key and number."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from drivers.errors import ConfigError
from rover_hil.gap import Channel, Parameter, Port, RunParameter, effects
from tests.sim_backends.state_model.machines import tank

KNOWN = Parameter(name="gain", unit="N m/V", nominal=0.085, prior_sd=0.003, lower=0.04, upper=0.2)
START = RunParameter(name="first_speed", unit="rad/s", prior_sd=2.0)


@pytest.mark.parametrize(
    ("declare", "message"),
    [
        (lambda: replace(KNOWN, prior_sd=-0.003), "parameter gain: prior_sd is -0.003, must be >= 0"),
        (lambda: replace(KNOWN, prior_sd=math.nan), "parameter gain: prior_sd is nan, must be >= 0"),
        (lambda: replace(KNOWN, scatter_sd=-1.0), "parameter gain: scatter_sd is -1, must be >= 0"),
        (
            lambda: replace(KNOWN, lower=0.3),
            "parameter gain: lower is 0.3, must be <= upper, which is 0.2",
        ),
        (
            lambda: replace(KNOWN, nominal=0.5),
            "parameter gain: nominal is 0.5, must be within lower and upper, 0.04 to 0.2",
        ),
        (lambda: replace(START, prior_sd=-2.0), "run parameter first_speed: prior_sd is -2, must be > 0"),
        (lambda: replace(START, prior_sd=0.0), "run parameter first_speed: prior_sd is 0, must be > 0"),
        (
            lambda: replace(START, lower=1.0),
            "run parameter first_speed: nominal is 0, must be within lower and upper, 1 to inf",
        ),
        (
            lambda: replace(START, channel="encoder", lower=1.0, upper=-1.0),
            "run parameter first_speed: lower is 1, must be <= upper, which is -1",
        ),
        (
            lambda: Port(name="torque", unit="N m", force_sd=-0.01),
            "port torque: force_sd is -0.01, must be > 0",
        ),
        (lambda: Port(name="torque", unit="N m", force_sd=0.0), "port torque: force_sd is 0, must be > 0"),
        (
            lambda: Channel(name="encoder", unit="rad", sigma=-0.005),
            "channel encoder: sigma is -0.005, must be >= 0",
        ),
        (
            lambda: Channel(name="encoder", unit="rad", quantum=-0.1),
            "channel encoder: quantum is -0.1, must be >= 0",
        ),
        (
            lambda: Channel(name="encoder", unit="rad", tolerance=-0.1),
            "channel encoder: tolerance is -0.1, must be >= 0",
        ),
        (lambda: replace(tank(), step_s=-0.04), "model tank: step_s is -0.04, must be > 0"),
    ],
)
def test_an_impossible_number_is_refused(declare: Callable[[], object], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        declare()
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("declare", "message"),
    [
        (
            lambda: effects.coulomb_friction("torque", velocity="speed", size=0.01, slow=-0.1),
            "effect coulomb_friction: slow is -0.1, must be > 0",
        ),
        (
            lambda: effects.coulomb_friction("torque", velocity="speed", size=0.0, slow=0.1),
            "effect coulomb_friction: size is 0, must be > 0",
        ),
        (
            lambda: effects.asymmetric_friction("torque", velocity="speed", size=0.1, slow=-1.0),
            "effect asymmetric_friction: slow is -1, must be > 0",
        ),
        (
            lambda: effects.stribeck_friction("torque", velocity="speed", size=0.1, speed=-1.0, slow=0.1),
            "effect stribeck_friction: speed is -1, must be > 0",
        ),
        (
            lambda: effects.presliding("torque", velocity="speed", size=0.1, distance=-1.0),
            "effect presliding: distance is -1, must be > 0",
        ),
        (
            lambda: effects.quadratic_drag("torque", velocity="speed", size=-1.0, name="drag"),
            "effect drag: size is -1, must be > 0",
        ),
        (
            lambda: effects.cogging("torque", position="angle", period=-1.0, size=0.1),
            "effect cogging: period is -1, must be > 0",
        ),
        (
            lambda: effects.end_stop("torque", position="angle", size=-1.0, places=(1.0,)),
            "effect end_stop: size is -1, must be > 0",
        ),
        (
            lambda: effects.two_body_backlash(
                "torque", inertia="inertia", load="encoder", ratio=1.0, size=0.1, impact_s=-0.1
            ),
            "effect backlash: impact_s is -0.1, must be > 0",
        ),
        (lambda: effects.offset("torque", size=-0.01), "effect offset: size is -0.01, must be > 0"),
        (lambda: effects.play("voltage", size=-0.01), "effect play: size is -0.01, must be > 0"),
        (
            lambda: effects.saturation("voltage", limits=(1.0, -2.0)),
            "effect saturation: limits[1] is -2, must be > 0",
        ),
        (
            lambda: effects.overflow("voltage", level="angle", limits=(1.0,), weir=-1.0),
            "effect overflow: weir is -1, must be >= 0",
        ),
        (lambda: effects.quantisation("voltage", step=-1.0), "effect quantisation: step is -1, must be > 0"),
        (
            lambda: effects.delay("voltage", size=0.01, longest=-0.2),
            "effect delay: longest is -0.2, must be > 0",
        ),
        (
            lambda: effects.wrong_parameter("gain", size=-0.01),
            "effect wrong_gain: size is -0.01, must be > 0",
        ),
        (
            lambda: effects.term("torque", source="speed", form="sign", size=-0.01, scale=1.0),
            "effect term: size is -0.01, must be > 0",
        ),
        (
            lambda: effects.threshold("torque", source="speed", place=1.0, size=-0.01),
            "effect threshold: size is -0.01, must be > 0",
        ),
        (
            lambda: effects.product("torque", sources=("speed", "angle"), size=-0.01),
            "effect product: size is -0.01, must be > 0",
        ),
        (
            lambda: effects.scattering(effects.offset("torque", size=0.1), sd=-1.0),
            "scattering effect at torque: sd is -1, must be >= 0",
        ),
    ],
)
def test_an_impossible_number_of_an_effect_is_refused(declare: Callable[[], object], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        declare()
    assert str(caught.value) == message


def test_zero_means_known_or_unknown() -> None:
    # A parameter without a spread is known; a channel without a sigma has unknown noise.
    assert replace(KNOWN, prior_sd=0.0).natural == KNOWN.nominal
    assert Channel(name="encoder", unit="rad", sigma=0.0).noise_sd == 0.0
