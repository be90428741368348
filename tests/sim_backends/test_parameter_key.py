"""What models and files call a parameter, of all runs or of one."""

import pytest

from rover_hil.gap.data.problem import split_point
from sim_backends.models.interface import Run, RunParameter, parameter
from sim_backends.models.parameter_key import ParameterKey, joined_name, read_key

RUN = Run(name="a~b@c", conditions={})
GAIN = parameter("gain", "1", 1.0, 0.1, 0.0, 2.0)
START = RunParameter(name="first", unit="m", prior_sd=1.0)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        (ParameterKey(name="gain"), "gain"),
        (ParameterKey(name="level", effect="drag"), "drag.level"),
        (START.key_in(RUN), "first@a~b@c"),
        (GAIN.deviation_in(RUN), "gain~@a~b@c"),
        (GAIN.deviation_in(RUN, "drag"), "drag.gain~@a~b@c"),
    ],
)
def test_each_kind_of_parameter_has_its_text(key: ParameterKey, text: str) -> None:
    assert key.text == text


def test_a_model_gets_values_of_single_runs_beside_its_base_parameters() -> None:
    level = ParameterKey(name="level", effect="drag")
    keys = (ParameterKey(name="gain"), START.key_in(RUN), GAIN.deviation_in(RUN, "drag"), level)
    parameters, effects = split_point({key: float(value) for value, key in enumerate(keys)})
    assert parameters == {"gain": 0.0, "first@a~b@c": 1.0, "drag.gain~@a~b@c": 2.0}
    assert effects == {"drag": {"level": 3.0}}


def test_the_parameter_of_whatever_run_is_the_same_in_two_runs() -> None:
    one, other = GAIN.deviation_in(RUN), GAIN.deviation_in(Run(name="d", conditions={}))
    assert one != other
    assert one.shared == other.shared
    assert one.shared != ParameterKey(name="gain")


@pytest.mark.parametrize(("effect", "name"), [("", "gain"), ("drag", "level"), ("heat += c * x**0.5", "c")])
def test_the_text_of_a_parameter_for_all_runs_is_read_back(effect: str, name: str) -> None:
    assert read_key(joined_name(effect, name)) == ParameterKey(effect=effect, name=name)
