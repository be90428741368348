"""Check the connection with ROS 2: interface, domain, and what other programs send there."""

from collections import Counter
from collections.abc import Iterator, Sequence

from drivers.errors import ConfigError
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.messages import Bool, Twist, TwistStamped, dds_name
from rover_hil.connect.ros2.neighbours import find_neighbours
from rover_hil.doctor.finding import Finding, ok, problem, warning

CHECK = "ROS 2"
LISTEN_S = 1.5
SHOW = "`ros2 topic info --verbose {}` names the program"


def check_ros2(settings: Ros2Settings | None) -> list[Finding]:
    """Check interface and domain of [ros2] and listen there; nothing without this section."""
    if settings is None:
        return []
    try:
        neighbours = find_neighbours(settings, LISTEN_S)
    except ConfigError as error:
        what, _, fix = str(error).partition(": ")[2].rpartition(": ")
        return [problem(CHECK, "ros2", what, "it cannot be used as the configuration says", fix)]
    findings = [
        *_foreign_types(settings, neighbours),
        *_other_rovers(settings, neighbours),
        *_access(settings),
    ]
    where = f"domain {settings.domain_id()} on the interface '{settings.interface}'"
    return findings or [ok(CHECK, "ros2", f"{where}, {len(neighbours)} writers of other programs")]


def _foreign_types(settings: Ros2Settings, neighbours: Sequence[tuple[str, str]]) -> Iterator[Finding]:
    expected = {"cmd_vel": (Twist, TwistStamped), "emergency_stop": (Bool,)}
    for name, messages in expected.items():
        topic = settings.topic(name)
        allowed = {dds_name(each.ros_type) for each in messages}
        shown = topic.removeprefix("rt")
        for foreign in sorted({kind for their_topic, kind in neighbours if their_topic == topic} - allowed):
            types = " or ".join(each.ros_type for each in messages)
            yield problem(
                CHECK,
                shown,
                f"a program sends the type {foreign.replace('::dds_::', '/').replace('::', '/').rstrip('_')}",
                f"only {types} is understood there, anything else is not seen at all",
                f"let it send {types}; {SHOW.format(shown)}",
            )


def _other_rovers(settings: Ros2Settings, neighbours: Sequence[tuple[str, str]]) -> Iterator[Finding]:
    topics = Counter(topic for topic, _ in neighbours)
    odometry = settings.topic("odom")
    if topics[odometry]:
        shown = odometry.removeprefix("rt")
        yield problem(
            CHECK,
            shown,
            f"{topics[odometry]} other programs send on {shown}",
            "another rover, or another run of this one, uses the same domain and namespace",
            f"end it, or choose another ros2.domain or ros2.namespace; {SHOW.format(shown)}",
        )
    velocity = settings.topic("cmd_vel")
    if settings.commands and topics[velocity] > 1:
        shown = velocity.removeprefix("rt")
        yield warning(
            CHECK,
            shown,
            f"{topics[velocity]} programs send on {shown}",
            "the first whose command arrives is followed until it is silent, the others are not",
            f"end those that are not to drive, or merge them with twist_mux; {SHOW.format(shown)}",
        )


def _access(settings: Ros2Settings) -> Iterator[Finding]:
    if settings.commands and settings.interface != "lo":
        yield warning(
            CHECK,
            "ros2.interface",
            f"every program that reaches the interface '{settings.interface}' can drive the rover",
            "DDS has no access control here",
            "use a network of its own, or a firewall",
        )
