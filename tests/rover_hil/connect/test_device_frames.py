"""Where the ground camera is on the rover, as a transform."""

import numpy as np
from scipy.spatial.transform import Rotation

from rover_hil.config import Config, load_config
from rover_hil.config.schema import find_rigs
from rover_hil.connect.ros2.device_frames import static_transforms


def test_the_frame_of_the_ground_camera_turns_its_axes_into_those_of_the_body() -> None:
    table = load_config("robotino-camera").model_dump(by_alias=True)
    config = Config.model_validate({**table, "ros2": {"base_frame": "robot"}})
    (found,) = static_transforms(config)
    (rig,) = find_rigs(config).values()
    assert (found.header.frame_id, found.child_frame_id) == ("robot", config.roles.camera)
    turned = found.transform.rotation
    matrix = Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]).as_matrix()
    np.testing.assert_allclose(matrix, rig.geometry().rotation, atol=1e-12)
    moved = found.transform.translation
    np.testing.assert_allclose([moved.x, moved.y, moved.z], rig.geometry().position_m)
    assert matrix[2, 2] < 0.0  # it looks down


def test_a_rover_without_a_camera_has_none() -> None:
    table = load_config("robotino").model_dump(by_alias=True)
    assert static_transforms(Config.model_validate({**table, "ros2": {}})) == ()
