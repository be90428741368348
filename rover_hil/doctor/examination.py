"""The whole examination, from the installation to the last sample."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib.metadata import packages_distributions, requires

from drivers.camera.settings import CameraSettings
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.clock import Clock
from drivers.device_settings import CanDeviceSettings
from drivers.errors import NotConnectedError
from drivers.registry import AnyDeviceSettings
from rover_hil.config import Config
from rover_hil.doctor.configuration.config_consistency import check_consistency
from rover_hil.doctor.devices.can_traffic import check_traffic
from rover_hil.doctor.devices.clocks import check_device_clock, check_host_clock, read_clocks
from rover_hil.doctor.devices.faults import check_faults
from rover_hil.doctor.devices.frames import check_frames
from rover_hil.doctor.devices.gyro_bandwidth import check_gyro_bandwidth
from rover_hil.doctor.devices.gyro_rate import check_gyro_rate
from rover_hil.doctor.devices.listening import OpenDevice, Reception, listen, open_device
from rover_hil.doctor.devices.no_data import check_no_data
from rover_hil.doctor.devices.rejections import check_rejections
from rover_hil.doctor.devices.streams import check_breaks, check_streams, parts_of
from rover_hil.doctor.finding import Finding, Level, SystemPaths, problem, warning
from rover_hil.doctor.host.can_interface import check_interface, read_ip_details
from rover_hil.doctor.host.installation import DISTRIBUTION, check_installation
from rover_hil.doctor.host.ports import busy, check_latency_timer, check_port, port_of
from rover_hil.doctor.host.ros2 import check_ros2
from rover_hil.doctor.host.scheduling import check_scheduling, may_use_realtime


def examine_computer(paths: SystemPaths) -> list[Finding]:
    """Check the installation and the scheduling."""
    return [
        *check_installation(packages_distributions(), requires(DISTRIBUTION) or ()),
        *check_scheduling(paths, realtime_allowed=may_use_realtime()),
    ]


def examine_rover(
    config: Config,
    paths: SystemPaths,
    clock: Clock,
    *,
    listen_s: float,
    on_progress: Callable[[float], None],
) -> list[Finding]:
    """Check the configuration and its devices, and listen to those that can be opened.

    Args:
        config: A configuration that fulfils `rover_hil.run.checks.RUN_CHECKS`.
        paths: Folders in which the system shows its devices.
        clock: The host's clock.
        listen_s: Duration of listening to all devices together.
        on_progress: Called with the seconds that have passed while listening.
    """
    before = read_clocks(clock)
    findings = [
        *check_consistency(config),
        *check_ros2(config.ros2),
    ]
    with ExitStack() as stack:
        opened: list[OpenDevice] = []
        for name, settings in config.devices.items():
            port_findings = _check_port(name, settings, paths)
            findings += port_findings
            if any(finding.level is Level.PROBLEM for finding in port_findings):
                continue
            device = _open(name, settings, paths, clock)
            if isinstance(device, Finding):
                findings.append(device)
                continue
            stack.callback(device.driver.close)
            opened.append(device)
        for device in opened:
            findings += _check_latency(device, paths)
        duration_s = listen_s if opened else 0.0
        request_rate_hz = config.loop.rate_hz
        receptions = listen(
            opened, clock, duration_s=duration_s, request_rate_hz=request_rate_hz, on_progress=on_progress
        )
    for reception in receptions:
        findings += check_reception(reception, config)
    return [*findings, *check_host_clock(before, read_clocks(clock))]


def check_reception(reception: Reception, config: Config) -> list[Finding]:
    """Check everything that one device sent."""
    name, settings = reception.device, reception.settings
    findings = [
        *check_no_data(reception),
        *check_streams(reception, parts_of(config, name), is_required=name in config.roles.names()),
        *check_breaks(reception),
        *check_rejections(reception),
        *check_faults(reception, bumper_stops=config.safety.bumper_stops),
        *check_device_clock(reception),
        *check_gyro_bandwidth(reception, config),
        *check_gyro_rate(reception, config),
    ]
    if isinstance(settings, CanWheelsSettings):
        findings += check_traffic(reception, settings)
    if isinstance(settings, CameraSettings):
        findings += check_frames(reception, settings)
    return findings


def _check_port(name: str, settings: AnyDeviceSettings, paths: SystemPaths) -> Sequence[Finding]:
    """Check the port of a device without opening it."""
    port = port_of(settings)
    if port is not None:
        return check_port(name, port, paths)
    if not isinstance(settings, CanDeviceSettings):
        return ()
    if settings.interface == "socketcan":
        return check_interface(name, settings, paths.sys, read_ip_details(settings.channel))
    return [
        warning(
            "CAN interface",
            name,
            f"{settings.channel} is a bus inside this process, without drives",
            'the interface "virtual" is for tests',
            f'in [devices.{name}] set interface = "socketcan" or "slcan", and channel to match',
        )
    ]


def _open(name: str, settings: AnyDeviceSettings, paths: SystemPaths, clock: Clock) -> OpenDevice | Finding:
    try:
        return open_device(name, settings, clock)
    except NotConnectedError as error:
        port = port_of(settings)
        if port is not None:
            return busy(name, port, paths, str(error))
        cause = "the configured interface, folder or file does not exist, or cannot be used"
        fix = (
            f"check channel or path in [devices.{name}]; "
            "for the simulated rover start `rover-hil simulate CONFIG` in this folder first"
        )
        return problem("port", name, str(error), cause, fix)


def _check_latency(device: OpenDevice, paths: SystemPaths) -> Sequence[Finding]:
    port = port_of(device.settings)
    return () if port is None else check_latency_timer(device.driver.name, port, paths)
