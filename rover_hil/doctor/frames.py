"""Do the frames of a camera come at the configured rate, with time stamps that can be true?"""

from drivers.camera.settings import CameraSettings
from drivers.clock import NANOSECONDS_PER_SECOND, seconds
from drivers.samples import FrameSample
from rover_hil.doctor.finding import Finding, ok, warning
from rover_hil.doctor.listening import Heard
from rover_hil.doctor.streams import stream_of

CHECK = "frames"
LOWEST_SHARE = 0.8


def check_frames(heard: Heard, settings: CameraSettings) -> list[Finding]:
    """Look at rate and time stamps of the frames that arrived; says nothing when none did."""
    frames = [sample for sample in heard.samples if isinstance(sample, FrameSample)]
    if not frames:
        return []
    findings: list[Finding] = []
    rate_hz = stream_of([frame.t_ns for frame in frames], heard.start_ns, heard.end_ns).rate_hz
    if rate_hz < LOWEST_SHARE * settings.frame_rate_hz:
        findings.append(
            warning(
                CHECK,
                heard.device,
                f"{rate_hz:.1f} frames per second, the configuration says {settings.frame_rate_hz:g}",
                "automatic exposure is long in dim light, the USB bus is full, or the source is slower",
                f"in [devices.{heard.device}] set exposure_100us (v4l2), or frame_rate_hz = {rate_hz:.1f}",
            )
        )
    ages_ns = [frame.t_ns - frame.t_capture_ns for frame in frames if frame.t_capture_ns is not None]
    if not ages_ns or not all(0 <= age_ns < NANOSECONDS_PER_SECOND for age_ns in ages_ns):
        worst = f": up to {seconds(max(ages_ns, key=abs)):.3f} s before arrival" if ages_ns else ""
        findings.append(
            warning(
                CHECK,
                heard.device,
                f"no usable capture times{worst}",
                "whoever makes the frames does not stamp them with this host's monotonic clock",
                "use a USB camera with the kernel's driver uvcvideo; frames now count as taken on arrival",
            )
        )
    if findings:
        return findings
    age_ms = 1000 * seconds(max(ages_ns))
    return [
        ok(CHECK, heard.device, f"{rate_hz:.1f} frames per second, at most {age_ms:.0f} ms old on arrival")
    ]
