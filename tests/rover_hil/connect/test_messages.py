"""The declared messages against the ones of ROS distributions, as the library rosbags has them."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from rover_hil.connect.ros2.messages import TYPE_HASHES, CompressedImage, Message, field_types
from rover_hil.exporting.rosbag_types import to_rosbags
from tests.rover_hil.connect.random_messages import random_message

DISTRIBUTIONS = [
    Stores.ROS2_FOXY,
    Stores.ROS2_GALACTIC,
    Stores.ROS2_HUMBLE,
    Stores.ROS2_IRON,
    Stores.ROS2_JAZZY,
    Stores.ROS2_KILTED,
]
MESSAGES = 50
SEED = 36


@pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=lambda each: each.value)
@pytest.mark.parametrize("message", [*TYPE_HASHES, CompressedImage], ids=lambda each: str(each.__name__))
def test_fields_and_hashes_are_those_of_ros(message: type[Message], distribution: Stores) -> None:
    store = get_typestore(distribution)
    _, declared = store.fielddefs[message.ros_type]
    assert list(field_types(message)) == [name for name, _ in declared]
    if message in TYPE_HASHES:
        assert TYPE_HASHES[message] == store.hash_rihs01(message.ros_type)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=lambda each: each.value)
@pytest.mark.parametrize("message", list(TYPE_HASHES), ids=lambda each: str(each.__name__))
def test_the_bytes_on_the_wire_are_those_of_ros(message: type[Message], distribution: Stores) -> None:
    pytest.importorskip("cyclonedds", reason="needs the extra `ros2`")
    from rover_hil.connect.ros2.dds_types import dds_type, from_dds, to_dds

    rng = np.random.default_rng(SEED)
    store = get_typestore(distribution)
    for number in range(MESSAGES):
        made = random_message(message, rng)
        data = to_dds(message)(made).serialize(use_version_2=False)
        expected = store.serialize_cdr(to_rosbags(made, store.types), message.ros_type)
        assert bytes(data) == bytes(expected), f"message {number} of seed {SEED}"
        assert from_dds(message)(dds_type(message).deserialize(data)) == made
