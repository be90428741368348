"""What is put together must fit together."""

from typing import Any

import pytest

from controllers.ground_motion.estimator import GroundMotionEstimator
from drivers.clock import VirtualClock
from drivers.errors import ConfigError
from drivers.link import NoTap
from rover_hil.config import Config, load_config
from rover_hil.run.composition import build_replay_rig


def test_a_drive_with_another_number_of_wheels_than_the_rover_is_refused() -> None:
    table = load_config("el-dorado").model_dump(by_alias=True)
    table["scomp"] = table["roles"]["camera"] = None
    table["rover"] = {"kinematics": "omni3", "wheel_radius_m": 0.04, "base_radius_m": 0.125}
    with pytest.raises(ConfigError, match=r"'omni3', which has 3 wheels, but device 'wheels' has 4"):
        build_replay_rig(Config.model_validate(table), VirtualClock(), NoTap())


@pytest.mark.parametrize(
    ("name", "rotates_about_origin"), [("el-dorado-camera", False), ("robotino-camera", True)]
)
def test_rotations_of_a_rover_that_skids_judge_no_camera(
    name: str, rotates_about_origin: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = list[bool]()
    begin = GroundMotionEstimator.__init__

    def noted(self: GroundMotionEstimator, *given: Any, rotates_about_origin: bool) -> None:
        found.append(rotates_about_origin)
        begin(self, *given, rotates_about_origin=rotates_about_origin)

    monkeypatch.setattr(GroundMotionEstimator, "__init__", noted)
    build_replay_rig(load_config(name), VirtualClock(), NoTap())
    assert found == [rotates_about_origin]
