"""The participant in DDS: its writers and readers, configured so that programs of ROS 2 match them."""

import os
import socket
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from drivers.errors import ConfigError
from rover_hil.config.ros2_settings import DOMAIN_VARIABLE, Ros2Settings
from rover_hil.connect.ros2.dds_types import dds_type, from_dds, to_dds
from rover_hil.connect.ros2.messages import TYPE_HASHES, Message

MOST_PARTICIPANTS = 32
"""Programs on one computer in one domain; each takes ports of its own."""
LOOPBACK = "lo"
DESCRIPTORS = Path("/proc/self/fd")
DEPTH = 10
MOST_WRITERS = 1000

ResultT = TypeVar("ResultT")
Send = Callable[[Message], None]
Received = tuple[Any, str, int]
"""A message, who sent it, and its source time in ns since 1970."""


def find_interface_mistake(settings: Ros2Settings) -> str:
    """Return why the network interface cannot be used; "" where it can."""
    names = [name for _, name in socket.if_nameindex()]
    if settings.interface in names:
        return ""
    return (
        f"ros2.interface: this computer has no network interface '{settings.interface}': "
        f"name one of {', '.join(names)}"
    )


def require_domain(settings: Ros2Settings) -> int:
    """Return the number of the domain.

    Raises:
        ConfigError: The environment variable holds no valid one.
    """
    domain = settings.domain_id()
    if domain is None:
        raise ConfigError(
            f"ros2.domain: the environment variable {DOMAIN_VARIABLE} is not a number from 0 to 101: "
            "correct it, or set the key"
        )
    return domain


def configuration(settings: Ros2Settings, domain: int) -> str:
    """Return the configuration of Cyclone DDS; with it the user's own has no effect.

    On the loopback participants are announced by multicast too, which does not leave the computer: Fast DDS
    announces itself by nothing else, and one that begins later than the rover would never be found.

    Type information of Fast DDS 1.15 and newer is ignored: Cyclone rejects that of every type with an array
    or a sequence, and then no message arrives (eclipse-cyclonedds/cyclonedds#2333).
    """
    is_loopback = settings.interface == LOOPBACK
    peers = [*settings.peers, *(["127.0.0.1"] if is_loopback else [])]
    listed = "".join(f'<Peer address="{peer}"/>' for peer in peers)
    interface = f'name="{settings.interface}"' + (' multicast="true"' if is_loopback else "")
    return (
        f'<CycloneDDS><Domain Id="{domain}">'
        f"<General><Interfaces><NetworkInterface {interface}/></Interfaces>"
        f"<AllowMulticast>{'spdp' if is_loopback else 'true'}</AllowMulticast></General>"
        "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>{MOST_PARTICIPANTS}</MaxAutoParticipantIndex>"
        f"<Peers>{listed}</Peers></Discovery>"
        "<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>"
        "</Domain></CycloneDDS>"
    )


def datagram_sockets() -> dict[str, int]:
    """Return the datagram sockets of IP in this process: file descriptors by their names in the kernel."""
    found = {}
    for path in DESCRIPTORS.iterdir():
        number = int(path.name)
        try:
            name = os.readlink(path)  # noqa: PTH115 (the name is no path)
        except FileNotFoundError:  # that of this list, which is closed
            continue
        if not name.startswith("socket:"):
            continue
        with socket.socket(fileno=os.dup(number)) as each:
            if each.family in (socket.AF_INET, socket.AF_INET6) and each.type == socket.SOCK_DGRAM:
                found[name] = number
    return found


def bind_to_loopback(descriptors: Iterable[int]) -> None:
    """Bind sockets to the loopback: Cyclone binds those that receive to all addresses.

    Raises:
        ConfigError: The kernel does not allow it.
    """
    for descriptor in descriptors:
        try:
            with socket.socket(fileno=os.dup(descriptor)) as each:
                each.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, LOOPBACK.encode())
        except OSError as error:
            raise ConfigError(
                f"ros2.interface: cannot bind the sockets to '{LOOPBACK}': {error.strerror}; "
                "Linux before 5.7 requires the capability CAP_NET_RAW"
            ) from error


class Node:
    """A participant of a domain.

    On the loopback its sockets receive what programs on this computer send and nothing else: readers are
    made after the sockets are bound.

    Args:
        settings: The section [ros2].

    Raises:
        ConfigError: The interface or the domain cannot be used.
    """

    def __init__(self, settings: Ros2Settings) -> None:
        self._settings = settings
        domain = require_domain(settings)
        mistake = find_interface_mistake(settings)
        if mistake:
            raise ConfigError(mistake)
        others = datagram_sockets()
        try:
            self._domain = Domain(domain, configuration(settings, domain))
            qos = Qos(Policy.Userdata(b"enclave=/;"), Policy.EntityName("rover_hil"))
            self._participant = DomainParticipant(domain, qos=qos)
        except DDSException as error:
            raise ConfigError(
                f"ros2.domain: no place in domain {domain} on the interface '{settings.interface}': "
                f"{MOST_PARTICIPANTS + 1} programs of ROS 2 may use it on one computer; end those that are "
                "not needed, or choose another domain"
            ) from error
        if settings.interface == LOOPBACK:
            bind_to_loopback(each for name, each in datagram_sockets().items() if name not in others)

    def writer(self, name: str, message: type[Message], *, latched: bool = False) -> Send:
        """Return a function that sends messages on a topic; it never waits for a reader.

        Args:
            name: Of the topic, without the namespace.
            message: Type of the messages.
            latched: Whether late readers get the last one.
        """
        qos = Qos(
            Policy.Reliability.Reliable(0),
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(1 if latched else DEPTH),
            _user_data(message),
        )
        writer = DataWriter(self._participant, self._topic(name, message), qos=qos)
        convert = to_dds(message)

        def send(sent: Message) -> None:
            writer.write(convert(sent))

        return partial(_with, self, send)

    def reader(
        self, name: str, message: type[Message], *, latched: bool = False, depth: int = 1
    ) -> Callable[[], Iterator[Received]]:
        """Return a function that gives what has arrived on a topic since its last call.

        Args:
            name: Of the topic, without the namespace.
            message: Type of the messages.
            latched: Whether the reader wants what was sent before, reliably: it matches only such writers.
                Otherwise it matches every writer.
            depth: How many of the newest messages are kept.
        """
        qos = Qos(
            Policy.Reliability.Reliable(0) if latched else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(depth),
            _user_data(message),
        )
        reader = DataReader(self._participant, self._topic(name, message), qos=qos)
        convert = from_dds(message)

        def take() -> Iterator[Received]:
            for sample in reader.take(max(depth, DEPTH)):
                info = sample.sample_info
                if info.valid_data:
                    yield convert(sample), f"{info.publication_handle:016x}", info.source_timestamp

        return partial(_with, self, take)

    def _topic(self, name: str, message: type[Message]) -> Topic:
        return Topic(self._participant, self._settings.topic(name), dds_type(message))

    def writers_of_others(self) -> "WritersOfOthers":
        """Return what finds the writers of other programs, those that are there already too."""
        return WritersOfOthers(self._participant)


class WritersOfOthers:
    """Finds the writers of other programs.

    Args:
        participant: The own one.
    """

    def __init__(self, participant: DomainParticipant) -> None:
        self._own = participant.guid
        self._reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)

    def take(self) -> list[tuple[str, str]]:
        """Return topic and type, by their names in DDS, of those that were found since the last call."""
        return [
            (each.topic_name, each.type_name)
            for each in self._reader.take(MOST_WRITERS)
            if each.topic_name and each.participant_key != self._own  # one that has ended has no name
        ]


def _with(node: Node, call: Callable[..., ResultT], *arguments: Message) -> ResultT:
    """Call a function of a writer or reader, which ends together with its participant: keep that."""
    return call(*arguments)


def _user_data(message: type[Message]) -> Any:
    # Without it rmw_cyclonedds from Iron on warns about each endpoint.
    return Policy.Userdata(f"typehash={TYPE_HASHES[message]};".encode())
