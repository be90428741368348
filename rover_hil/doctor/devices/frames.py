"""Check rate and time stamps of the frames of a camera."""

from drivers.camera.codec import LARGEST_LEAD_NS, OLDEST_NS
from drivers.camera.settings import CameraSettings
from drivers.clock import seconds
from drivers.samples import FrameSample
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.devices.streams import stream_of
from rover_hil.doctor.finding import Finding, ok, warning

CHECK = "frames"
LOWEST_SHARE = 0.8


def _slower(device: str, settings: CameraSettings) -> str:
    """Return what to do about slow frames; a v4l2 camera gives only the rates that it lists."""
    if settings.source != "v4l2":
        return f"in [devices.{device}] set frame_rate_hz to what the source delivers"
    return (
        f"in [devices.{device}] set frame_rate_hz to the next lower rate of `v4l2-ctl --list-formats-ext "
        f"-d {settings.path}`; or exposure_100us, if `v4l2-ctl --list-ctrls -d {settings.path}` lists "
        "exposure_time_absolute"
    )


def check_frames(reception: Reception, settings: CameraSettings) -> list[Finding]:
    """Check rate and time stamps of the frames that arrived; no finding when none did."""
    frames = [sample for sample in reception.samples if isinstance(sample, FrameSample)]
    if not frames:
        return []
    findings: list[Finding] = []
    device = reception.device
    rate_hz = stream_of([frame.t_ns for frame in frames], reception.start_ns, reception.end_ns).rate_hz
    if rate_hz < LOWEST_SHARE * settings.frame_rate_hz:
        findings.append(
            warning(
                CHECK,
                reception.device,
                f"{rate_hz:.1f} frames per second, configured are {settings.frame_rate_hz:g}",
                "automatic exposure is long in dim light, the USB bus is full, or the source is slower",
                _slower(device, settings),
            )
        )
    ages_ns = [frame.t_ns - frame.t_capture_ns for frame in frames if frame.t_capture_ns is not None]
    if not ages_ns or not all(-LARGEST_LEAD_NS <= age_ns < OLDEST_NS for age_ns in ages_ns):
        worst = f": up to {seconds(max(ages_ns, key=abs)):.3f} s before arrival" if ages_ns else ""
        findings.append(
            warning(
                CHECK,
                reception.device,
                f"no usable capture times{worst}",
                "the source of the frames does not stamp them "
                "with this host's monotonic clock, or its stamps stand still",
                "use a USB camera with the driver uvcvideo; otherwise the arrival counts as the capture",
            )
        )
    if findings:
        return findings
    age_ms = 1000 * seconds(max(0, *ages_ns))
    return [
        ok(
            CHECK,
            reception.device,
            f"{rate_hz:.1f} frames per second, at most {age_ms:.0f} ms old on arrival",
        )
    ]
