"""The middleware of nodes that stream: no shared memory, which another process can keep locked.

A process that is killed or stopped while it holds the lock of a shared-memory port of Fast DDS blocks the next process
that publishes to it, for up to a second. UDP has no such lock.

rmw_fastrtps adds shared memory by itself, whatever a profile or FASTDDS_BUILTIN_TRANSPORTS say, where
ROS_AUTOMATIC_DISCOVERY_RANGE is LOCALHOST. This process then uses SYSTEM_DEFAULT, with a profile that has the same
discovery.
"""

import os
import re
import socket
import tempfile
from collections.abc import Iterator, Mapping, Sequence
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
    environment = dict(os.environ)
    with tempfile.TemporaryDirectory() as folder:
        variables = _variables(environment, Path(folder))
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


def _variables(environment: Mapping[str, str], folder: Path) -> dict[str, str | None]:
    """Return {name: value, None to unset} of the variables to change. folder: for a profile that is written."""
    transports = environment.get(TRANSPORTS, "")
    if "fastrtps" not in get_rmw_implementation_identifier() or transports not in ("", "UDPv4"):
        return {}
    if _has_profile(environment):
        return {TRANSPORTS: "UDPv4"}  # applies if the profile leaves the transports open
    localhost_only = environment.get(LOCALHOST_ONLY) == "1"
    if not localhost_only and environment.get(RANGE, "") in NON_LOCAL_RANGES:
        return dict.fromkeys(PROFILE_VARIABLES, str(PROFILES / "udp.xml"))
    peers = "" if localhost_only else environment.get(PEERS, "")
    profile = str(_localhost_profile(peers.split(";"), folder))
    return {**dict.fromkeys(PROFILE_VARIABLES, profile), RANGE: "SYSTEM_DEFAULT", LOCALHOST_ONLY: None}


def _has_profile(environment: Mapping[str, str]) -> bool:
    if any(environment.get(name) for name in PROFILE_VARIABLES):
        return True
    if environment.get("SKIP_DEFAULT_XML_FILE") == "1":
        return False
    return any(Path(name).exists() for name in WORKING_FOLDER_PROFILES)


def _localhost_profile(peers: Sequence[str], folder: Path) -> Path:
    """Return the path of a profile for this machine and static peers (names or addresses)."""
    shipped = PROFILES / "udp_localhost.xml"
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
