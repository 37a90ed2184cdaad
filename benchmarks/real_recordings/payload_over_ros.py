"""Payloads of a real UR10e that the node `payload_identifier` finds while its recordings are played over DDS.

Recordings, gains and models without load are those of `payload.py`. Each loaded recording is published on joint_states
by a process of its own, four times as fast as it was recorded. First the node has the model of the pair, then the
published URDF, with the recording without load of the pair as its measurement without load.

    python benchmarks/real_recordings/payload_over_ros.py CHECKOUT

CHECKOUT is a checkout of github.com/shamilmamedov/dynamic_calibration.
"""

from __future__ import annotations

import argparse
import logging
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from drive_gains import LINK, PAIRS, controller_gains, read_signals
from payload import Result, fit_model, print_result, print_summary, write_table
from std_srvs.srv import Trigger

from robot_dynamics import load_robot
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.processes import running_node
from robot_dynamics_interfaces.srv import IdentifyPayload

PUBLISHER = Path(__file__).parents[2] / "test/nodes/table_publisher.py"
NODE = "/payload_identifier"
SPEED = "4"


def measure(table: str, clients: tuple[ServiceClient, ServiceClient], **fields: Any) -> IdentifyPayload.Response:
    """Play a recording once while the node measures, and return its response."""
    request = IdentifyPayload.Request(duration=100.0, link=LINK, **fields)
    with ThreadPoolExecutor(1) as pool:
        response = pool.submit(clients[0].call, IdentifyPayload, f"{NODE}/identify_payload", request, 200.0)
        subprocess.run([sys.executable, PUBLISHER, table, "/joint_states", SPEED, "once"], check=True)
        clients[1].call(Trigger, f"{NODE}/stop", Trigger.Request())
        return response.result()


def result_of(response: IdentifyPayload.Response, truth: float) -> Result:
    """The figures of a response."""
    assert response.success, response.message
    vectors = (response.centre, response.centre_deviation)
    return Result(
        response.mass, response.mass_deviation, truth, *(np.array([vector.x, vector.y, vector.z]) for vector in vectors)
    )


def main() -> None:
    """Print the table of a checkout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path)
    checkout = parser.parse_args().checkout
    logging.disable(logging.WARNING)
    source = checkout / "dataset_ur10e/identification_data"
    robot = str(checkout / "URe/urdf/ur10e.urdf")
    joints = [joint.name for joint in load_robot(robot).joints]
    gains = np.mean(
        [controller_gains(read_signals(source, pair.loaded, pair.loaded_rows))[0] for pair in PAIRS.values()], axis=0
    )
    rclpy.init()
    clients = (ServiceClient("measuring"), ServiceClient("stopping"))
    results: dict[str, list[Result]] = {"model of the pair": [], "published URDF with a measurement without load": []}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for name, pair in PAIRS.items():
            loaded, empty = (
                write_table(source / f"{file}.csv", folder / f"{file}.csv", rows, gains, joints)
                for file, rows in ((pair.loaded, pair.loaded_rows), (pair.unloaded, pair.unloaded_rows))
            )
            model = dict(zip(("robot", "drives"), fit_model(folder, empty, robot).arguments[1::2], strict=True))
            with running_node("payload_identifier", {"robot_file": model["robot"], "drives": model["drives"]}):
                result = result_of(measure(loaded, clients), pair.mass)
            print_result(f"{name}, model of the pair", result)
            results["model of the pair"].append(result)
            with running_node("payload_identifier", {"robot_file": robot}):
                kept = measure(empty, clients, without_load=True)
                assert kept.success, kept.message
                result = result_of(measure(loaded, clients, use_without_load=True), pair.mass)
            print_result(f"{name}, published URDF, with a measurement without load", result)
            results["published URDF with a measurement without load"].append(result)
    for title, values in results.items():
        print_summary(title, values)
    for client in clients:
        client.close()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
