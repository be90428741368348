"""A peer in the process of the tests: a library of DDS takes one configuration of a domain per process."""

from typing import TYPE_CHECKING

import pytest

from rover_hil.config.ros2_settings import Ros2Settings
from tests.rover_hil.connect.by_hand import own_domain

if TYPE_CHECKING:
    from rover_hil.connect.ros2.node import Node


@pytest.fixture(scope="session")
def peer() -> "Node":
    pytest.importorskip("cyclonedds", reason="needs the extra `ros2`")
    from rover_hil.connect.ros2.node import Node

    return Node(Ros2Settings(domain=own_domain()))
