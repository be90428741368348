import math

import numpy as np
import pytest

from controllers.slip.scomp.motion_model import GAIN, RESIDUAL, SECOND, TRACE_NOISE, MotionModel, Tilt
from controllers.slip.scomp.parameters import ScompParameters, SlipFromPitch
from controllers.slip.scomp.slip_laws import PitchLaw, TwoSegmentLaw, slopes

PITCH_RAD = math.radians(8.0)
TILT = Tilt(pitch_rad=PITCH_RAD, expected_drift_rad=0.1)


def test_moves_by_the_slip_that_the_pitch_asks_for() -> None:
    parameters = ScompParameters()
    model = MotionModel(parameters, PitchLaw(parameters), follows_roll=False)
    travel = model.predict(model.start()[0], TILT, 0.1).travel
    slip = parameters.pitch.model.slip_at(math.sin(PITCH_RAD) + parameters.pitch.rolling_resistance, 0.0)
    assert travel == pytest.approx(1.0 - slip)


@pytest.mark.parametrize("law_of", [PitchLaw, TwoSegmentLaw])
def test_jacobian_of_the_motion(law_of: type[PitchLaw] | type[TwoSegmentLaw]) -> None:
    parameters = ScompParameters()
    model = MotionModel(parameters, law_of(parameters), follows_roll=True)
    values, _ = model.start()
    values[[RESIDUAL, GAIN]] = 0.2, 1.3
    found = model.predict(values, TILT, 0.1).slopes
    for index in range(len(values)):
        ends = []
        for change in (-1e-4, 1e-4):
            shifted = values.copy()
            shifted[index] += change
            ends.append(model.predict(shifted, TILT, 0.1).travel)
        assert found[index] == pytest.approx((ends[1] - ends[0]) / 2e-4, abs=1e-4), index
    assert abs(found[SECOND]) > 1e-3
    assert found[TRACE_NOISE] == 0.0


def test_the_states_stay_as_uncertain_as_they_were() -> None:
    parameters = ScompParameters()
    model = MotionModel(parameters, PitchLaw(parameters), follows_roll=True)
    values, variances = model.start()
    found = model.predict(values, TILT, 0.3)
    kept = found.transition @ np.diag(variances) @ found.transition.T + found.noise
    assert kept[:3, :3] == pytest.approx(np.diag(variances)[:3, :3], abs=1e-12)


def test_slopes_of_the_law() -> None:
    law = PitchLaw(ScompParameters())
    slip, over_angle, over_first, over_second = slopes(law, 0.2, PITCH_RAD, law.first, law.second)
    assert slip == law.slip_at(0.2, PITCH_RAD, law.first, law.second)
    assert over_angle > 0.0
    assert over_first > 1.0
    assert over_second < 0.0


def test_the_fit_is_kept_along_the_direction_it_does_not_determine() -> None:
    pitch = SlipFromPitch(stiffness_follows=8.0)
    law = PitchLaw(ScompParameters(pitch=pitch))
    free = PitchLaw(ScompParameters(pitch=replace_follows(pitch)))
    steps = [item.slip_at(0.0, PITCH_RAD, item.first + 0.02, item.second) for item in (law, free)]
    level = law.slip_at(0.0, PITCH_RAD, law.first, law.second)
    assert abs(steps[0] - level) < 0.5 * abs(steps[1] - level)


def replace_follows(pitch: SlipFromPitch) -> SlipFromPitch:
    return pitch.model_copy(update={"stiffness_follows": 0.0})
