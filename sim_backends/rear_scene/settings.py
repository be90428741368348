"""Settings of the simulated rear camera and of the ground in its view."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from drivers.settings import Settings

LensCoefficient: TypeAlias = Annotated[float, Field(ge=-1, le=1)]
GroundKind: TypeAlias = Literal[
    "fine_sand", "coarse_sand", "rippled_sand", "patchy_sand", "gravel", "grass", "brick", "sandy_gravel"
]
ShadowOf: TypeAlias = Literal["four_wheels", "robotino", "nothing"]
Share: TypeAlias = Annotated[float, Field(ge=0, le=1)]


class DirtSettings(Settings):
    """Specks on the lens: they stand still in the image.

    Attributes:
        specks: How many there are.
        opacity: Greatest share of the light that a speck takes; each takes from a third of it to all of it.
        radius_px: Median radius.
        edge_px: Standard deviation of the blur of their edges.
    """

    specks: Annotated[int, Field(ge=0, le=1000)] = 0
    opacity: Share = 0.6
    radius_px: Annotated[float, Field(ge=1, le=100)] = 6.0
    edge_px: Annotated[float, Field(ge=0.3, le=30)] = 1.5


class CanopySettings(Settings):
    """Shadows of leaves or clouds on the ground: they stand still in the world, or pass over it.

    Attributes:
        cover: Share of the ground in shadow.
        strength: Share of the sun that the shadows take: 1 is a hard shadow.
        size_m: Width of the smallest shadows; the largest are eight times as wide.
        edge_m: Standard deviation of the blur of their edges.
        speed_m_s: Speed at which they pass.
        direction_deg: Direction of it in the world, counter-clockwise from x.
    """

    cover: Annotated[float, Field(ge=0, le=0.95)] = 0.0
    strength: Share = 1.0
    size_m: Annotated[float, Field(ge=0.03, le=0.5)] = 0.08
    edge_m: Annotated[float, Field(ge=0.002, le=0.3)] = 0.004
    speed_m_s: Annotated[float, Field(ge=0, le=5)] = 0.0
    direction_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class CameraEmulatorSettings(Settings):
    """Where the simulated camera looks, how well, and what disturbs it.

    The camera is above and a little behind the point where a wheel touches the ground, by default the rear
    left one of the simulated four-wheeled rover, looks backwards unless it is panned, and is tilted down. It
    sees about 0.7 m x 0.7 m of ground by default; the rear camera of the rover El-Dorado saw 0.6 m x 0.8 m.
    The other three wheels mirror this one about the rover's axes. On a rover that leaves no traces, the wheel
    is only the point that the camera is behind.

    Attributes:
        wheel_x_m: Contact point of the wheel, forward of the rover's origin.
        wheel_y_m: Contact point of the wheel, to the left of the rover's origin.
        behind_m: Distance of the camera behind that point.
        height_m: Height of the camera above the floor of the trace.
        tilt_deg: Angle of the optical axis below the horizontal.
        pan_deg: Angle of the optical axis about the vertical, counter-clockwise from straight back.
        bank_deg: Angle of the image about the optical axis; 180 for a camera upside down.
        horizontal_view_deg: Angle of view over the width of the image.
        distortion: k1, k2, p1, p2, k3 of the lens, as OpenCV defines them.
        trace_width_m: Width of the wheels.
        leaves_traces: Whether the wheels leave traces, and the wheel is in front of the camera.
        rut_depth_m: Sinkage of the wheels, and of the rover with the camera.
        sinkage_per_slip_m: Further sinkage at a slip of 1; it is reached while the wheels turn by some rad.
        ground: Appearance of the ground.
        stones_per_m2: Number of loose stones per square metre.
        sun_azimuth_deg: Direction to the sun in the world, counter-clockwise from x.
        sun_elevation_deg: Elevation of the sun above the ground.
        canopy: Shadows of leaves or clouds.
        shadow_of: Rover whose shadow falls on the ground.
        rock_deg: Standard deviation of the body's rocking, about x and about y.
        vibration_deg: Amplitude of the body's vibration, about x and about y.
        vibration_hz: Frequency of it.
        noise_grey: Standard deviation of the noise of a pixel, in grey levels of 255.
        blur_px: Standard deviation of the optical blur.
        contrast: Contrast of the image over that of a clear one: below 1 in haze and against the light.
        dirt: Specks on the lens.
        gain: Exposure over the right one: below 1 the image is dark.
        gain_swing: Standard deviation of the exposure's logarithm, which changes within half a second.
        exposure_s: Exposure of a line of the image.
        readout_s: Time from the exposure of the first line to that of the last: a rolling shutter.
        transfer_s: Time from the end of the exposure to the arrival at the host.
        repeat_share: Share of the frames that show the image of the frame before.
    """

    type: Literal["camera"]
    wheel_x_m: Annotated[float, Field(ge=-5, le=5)] = -0.3
    wheel_y_m: Annotated[float, Field(ge=-5, le=5)] = 0.22
    behind_m: Annotated[float, Field(ge=-0.5, le=1)] = 0.02
    height_m: Annotated[float, Field(ge=0.1, le=3)] = 0.5
    tilt_deg: Annotated[float, Field(gt=0, le=90)] = 60.0
    pan_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    bank_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    horizontal_view_deg: Annotated[float, Field(ge=10, le=120)] = 60.0
    distortion: tuple[LensCoefficient, LensCoefficient, LensCoefficient, LensCoefficient, LensCoefficient] = (
        -0.12,
        0.01,
        0.0,
        0.0,
        0.0,
    )
    trace_width_m: Annotated[float, Field(gt=0, le=0.3)] = 0.11
    leaves_traces: bool = True
    rut_depth_m: Annotated[float, Field(ge=0.001, le=0.03)] = 0.014
    sinkage_per_slip_m: Annotated[float, Field(ge=0, le=0.03)] = 0.0
    ground: GroundKind = "fine_sand"
    stones_per_m2: Annotated[float, Field(ge=0, le=100)] = 3.0
    sun_azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 75.0
    sun_elevation_deg: Annotated[float, Field(ge=15, le=90)] = 50.0
    canopy: CanopySettings = CanopySettings()
    shadow_of: ShadowOf = "four_wheels"
    rock_deg: Annotated[float, Field(ge=0, le=5)] = 0.2
    vibration_deg: Annotated[float, Field(ge=0, le=2)] = 0.0
    vibration_hz: Annotated[float, Field(ge=1, le=200)] = 25.0
    noise_grey: Annotated[float, Field(ge=0, le=50)] = 3.0
    blur_px: Annotated[float, Field(ge=0.3, le=20)] = 0.6
    contrast: Annotated[float, Field(gt=0, le=1)] = 1.0
    dirt: DirtSettings = DirtSettings()
    gain: Annotated[float, Field(ge=0.02, le=10)] = 1.0
    gain_swing: Annotated[float, Field(ge=0, le=1)] = 0.0
    exposure_s: Annotated[float, Field(ge=0, le=0.1)] = 0.008
    readout_s: Annotated[float, Field(ge=0, le=0.05)] = 0.0
    transfer_s: Annotated[float, Field(gt=0, le=0.1)] = 0.006
    repeat_share: Annotated[float, Field(ge=0, le=0.9)] = 0.0
