"""The transports of the middleware: none by shared memory for nodes that stream, more of it for large messages.

A process that is killed or stopped while it holds the lock of a shared-memory port of Fast DDS blocks the next process
that publishes to it, for up to a second. UDP has no such lock.

The shared memory of a process has 512 kB by default. The parts of a larger message that do not fit are lost at first,
and sent again after 10 ms or more.

rmw_fastrtps adds shared memory of that size by itself, whatever a profile or FASTDDS_BUILTIN_TRANSPORTS say, where
ROS_AUTOMATIC_DISCOVERY_RANGE is LOCALHOST. This process then uses SYSTEM_DEFAULT, with a profile that has the same
discovery.
"""

import os
import re
import socket
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier

PROFILES = Path(__file__).with_name("fastdds")
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")  # Fast DDS 2, from 3 on
WORKING_FOLDER_PROFILES = ("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml")
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOCALHOST_ONLY = "ROS_LOCALHOST_ONLY"
PEERS = "ROS_STATIC_PEERS"
NON_LOCAL_RANGES = ("", "SUBNET", "OFF", "SYSTEM_DEFAULT")  # ROS treats all others as LOCALHOST
SEGMENT = re.compile(r"/dev/shm/fast(?:rtps|dds)_\S+")


@contextmanager
def without_shared_memory() -> Iterator[None]:
    """Make participants of Fast DDS that this process creates in the block use UDP alone.

    Choices of the user have priority: another middleware, a profile, transports. `shared_memory` returns the outcome.
    Raises RuntimeError if the address of a static peer is unknown.
    """
    with _changed(_udp_variables):
        yield


@contextmanager
def large_messages() -> Iterator[None]:
    """Give participants of Fast DDS that this process creates in the block shared memory for messages of megabytes.

    Sender and receiver are independent: each process needs it for what it sends. Put `rclpy.init()` and the creation of
    the first node into the block.

    Choices of the user have priority: another middleware, a profile, transports. Raises RuntimeError if the address of
    a static peer is unknown.
    """
    with _changed(_large_message_variables):
        yield


@contextmanager
def _changed(choose: Callable[[Mapping[str, str], Path], dict[str, str | None]]) -> Iterator[None]:
    """Change environment variables in a block. choose: returns them; it may write a profile into a folder."""
    environment = dict(os.environ)
    with tempfile.TemporaryDirectory() as folder:
        variables = choose(environment, Path(folder))
        try:
            _set(variables)
            yield
        finally:
            _set({name: environment.get(name) for name in variables})


def shared_memory() -> list[str]:
    """Return the names of the shared memory by which Fast DDS connects this process with others."""
    maps = Path("/proc/self/maps")
    return sorted(set(SEGMENT.findall(maps.read_text()))) if maps.exists() else []


def _set(variables: Mapping[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def _udp_variables(environment: Mapping[str, str], folder: Path) -> dict[str, str | None]:
    """Return {name: value, None to unset} of the variables to change. folder: for a profile that is written."""
    if not _is_fast_dds() or environment.get(TRANSPORTS, "") not in ("", "UDPv4"):
        return {}
    if _has_profile(environment):
        return {TRANSPORTS: "UDPv4"}  # applies if the profile leaves the transports open
    return _profile_variables("udp", environment, folder)


def _large_message_variables(environment: Mapping[str, str], folder: Path) -> dict[str, str | None]:
    """As `_udp_variables`."""
    if not _is_fast_dds() or environment.get(TRANSPORTS) or _has_profile(environment):
        return {}
    return _profile_variables("large_messages", environment, folder)


def _is_fast_dds() -> bool:
    return "fastrtps" in get_rmw_implementation_identifier()


def _profile_variables(name: str, environment: Mapping[str, str], folder: Path) -> dict[str, str | None]:
    """Return the variables for a profile that ships, in the discovery range of the environment."""
    localhost_only = environment.get(LOCALHOST_ONLY) == "1"
    if not localhost_only and environment.get(RANGE, "") in NON_LOCAL_RANGES:
        return dict.fromkeys(PROFILE_VARIABLES, str(PROFILES / f"{name}.xml"))
    peers = "" if localhost_only else environment.get(PEERS, "")
    profile = str(_localhost_profile(f"{name}_localhost.xml", peers.split(";"), folder))
    return {**dict.fromkeys(PROFILE_VARIABLES, profile), RANGE: "SYSTEM_DEFAULT", LOCALHOST_ONLY: None}


def _has_profile(environment: Mapping[str, str]) -> bool:
    if any(environment.get(name) for name in PROFILE_VARIABLES):
        return True
    if environment.get("SKIP_DEFAULT_XML_FILE") == "1":
        return False
    return any(Path(name).exists() for name in WORKING_FOLDER_PROFILES)


def _localhost_profile(name: str, peers: Sequence[str], folder: Path) -> Path:
    """Return the path of a profile for this machine and static peers (names or addresses)."""
    shipped = PROFILES / name
    peers = [peer for peer in peers if peer]
    if not peers:
        return shipped
    locators = ""
    for peer in peers:
        try:
            address = socket.gethostbyname(peer)
        except OSError as error:
            raise RuntimeError(f"{PEERS} names {peer!r}, whose address is not known: {error}") from None
        locators += f"<locator><udpv4><address>{address}</address></udpv4></locator>"
    end = "</initialPeersList>"
    path = folder / shipped.name
    path.write_text(shipped.read_text().replace(end, locators + end))
    return path
