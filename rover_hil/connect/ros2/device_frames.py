"""Where the devices of a rover are on it."""

from rover_hil.config import Config
from rover_hil.config.schema import find_rigs
from rover_hil.connect.ros2.messages import (
    Header,
    Quaternion,
    Time,
    Transform,
    TransformStamped,
    Vector3,
)


def static_transforms(config: Config) -> tuple[TransformStamped, ...]:
    """Return the transforms from the body to the devices whose place is known: the ground camera.

    The frame of a device has its name. That of a camera has x to the right, y down and z ahead.
    """
    camera, settings = config.roles.camera, config.ros2
    rig = next(iter(find_rigs(config).values()), None)
    if camera is None or rig is None or settings is None:
        return ()
    # Imported here because only a rover with a camera needs it.
    from scipy.spatial.transform import Rotation

    geometry = rig.geometry()
    x, y, z, w = Rotation.from_matrix(geometry.rotation).as_quat().tolist()
    forward_m, left_m, up_m = geometry.position_m.tolist()
    place = Transform(Vector3(forward_m, left_m, up_m), Quaternion(x, y, z, w))
    return (TransformStamped(Header(Time(), settings.base_frame), camera, place),)
