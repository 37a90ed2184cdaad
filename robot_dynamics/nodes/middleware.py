"""The middleware of nodes that stream: no shared memory, which another process that dies or stops can keep locked.

A process that is killed or stopped while it holds the lock of a shared-memory port of Fast DDS blocks whoever publishes
to it next, for up to a second. UDP has no such lock.

rmw_fastrtps adds shared memory by itself, whatever profile or FASTDDS_BUILTIN_TRANSPORTS say, where
ROS_AUTOMATIC_DISCOVERY_RANGE is LOCALHOST: it is SYSTEM_DEFAULT then for this process, with a profile that has the same
discovery.
"""

import os
import re
import socket
import tempfile
from contextlib import contextmanager
from pathlib import Path

import rclpy

PROFILES = Path(__file__).with_name("fastdds")
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")  # Fast DDS 2, from 3 on
PROFILES_OF_FOLDER = ("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml")  # read where a process starts
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
RANGE, ONLY_HERE, PEERS = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS"
OTHER_RANGES = ("", "SUBNET", "OFF", "SYSTEM_DEFAULT")  # ROS takes all others for LOCALHOST
SEGMENT = re.compile(r"/dev/shm/fast(?:rtps|dds)_\S+")


@contextmanager
def without_shared_memory():
    """Participants of Fast DDS that this process makes meanwhile use UDP alone.

    What the user has chosen stays as it is: another middleware, a profile, transports. `shared_memory` says what came
    of it. Raises RuntimeError where a static peer has no address.
    """
    before = dict(os.environ)
    with tempfile.TemporaryDirectory() as folder:
        variables = _variables(before, Path(folder))
        try:
            _set(variables)
            yield
        finally:
            _set({name: before.get(name) for name in variables})


def shared_memory():
    """Names of the shared memory by which Fast DDS talks to other processes from this one."""
    maps = Path("/proc/self/maps")
    return sorted(set(SEGMENT.findall(maps.read_text()))) if maps.exists() else []


def _set(variables):
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def _variables(environment, folder):
    """{name: value, None for none} of the variables to change in an environment. folder: takes a profile."""
    chosen = environment.get(TRANSPORTS, "")
    if "fastrtps" not in rclpy.get_rmw_implementation_identifier() or chosen not in ("", "UDPv4"):
        return {}
    if _has_profile(environment):
        return {TRANSPORTS: "UDPv4"}  # holds where the profile leaves the transports open
    only_here = environment.get(ONLY_HERE) == "1"
    if not only_here and environment.get(RANGE, "") in OTHER_RANGES:
        return dict.fromkeys(PROFILE_VARIABLES, str(PROFILES / "udp.xml"))
    peers = "" if only_here else environment.get(PEERS, "")
    variables = dict.fromkeys(PROFILE_VARIABLES, str(_localhost_profile(peers.split(";"), folder)))
    return {**variables, RANGE: "SYSTEM_DEFAULT", ONLY_HERE: None}


def _has_profile(environment):
    if any(environment.get(name) for name in PROFILE_VARIABLES):
        return True
    return environment.get("SKIP_DEFAULT_XML_FILE") != "1" and any(Path(name).exists() for name in PROFILES_OF_FOLDER)


def _localhost_profile(peers, folder):
    """The path of a profile for this machine, and for static peers (names or addresses)."""
    shipped = PROFILES / "udp_localhost.xml"
    peers = [peer for peer in peers if peer]
    if not peers:
        return shipped
    end, locators = "</initialPeersList>", ""
    for peer in peers:
        try:
            address = socket.gethostbyname(peer)
        except OSError as error:
            raise RuntimeError(f"{PEERS} names {peer!r}, whose address is not known: {error}") from None
        locators += f"<locator><udpv4><address>{address}</address></udpv4></locator>"
    path = folder / shipped.name
    path.write_text(shipped.read_text().replace(end, locators + end))
    return path
