"""Efforts that stream for long: the memory of the node stays what it was, and no reference is missed.

`make soak` runs it with SOAK_SECONDS=600; the default is short.
"""

import os
import time

import numpy as np
from nodes.controller_probe import PANDA, ControllerProbe, Q, trajectory_message
from nodes.faults.bench import own_memory

from robot_dynamics.nodes.processes import running_node

SECONDS = float(os.environ.get("SOAK_SECONDS", "10"))
RATE, REFERENCES = 1000.0, 50.0  # [1/s]
GROWTH = 1_000_000  # [bytes] from a tenth of the time on, as Python and the middleware fill their pools first


def test_long_stream_neither_grows_nor_misses_a_reference(ros, client):
    parameters = {"robot_file": "panda", "state_timeout": 0.5, "reference_timeout": 2.0, "deadline": 1.0}
    with running_node("computed_torque", parameters, "/soak") as process:
        stand = ControllerProbe("/soak/computed_torque", client, history=1000)
        try:
            stand.stream_until_steady()
            first = len(stand.diagnostics)
            began = following = reference = time.monotonic()
            kept, states, sent = None, 0, 0
            while (now := time.monotonic()) < began + SECONDS:
                stand.publish(q=Q + 1e-3 * np.sin(now - began))
                states += 1
                if now >= reference:
                    stand.reference_point.publish(trajectory_message(PANDA, [0.0], [Q], [np.zeros(7)], [np.zeros(7)]))
                    reference, sent = reference + 1 / REFERENCES, sent + 1
                if kept is None and now > began + max(SECONDS / 10, min(60.0, SECONDS / 2)):
                    kept = own_memory(process)
                following = max(following + 1 / RATE, now - 0.05)
                time.sleep(max(0.0, following - time.monotonic()))
            grown = own_memory(process) - kept
            told_of = stand.diagnostics[first:]
            last = told_of[-1][2]
            print(f"\n{SECONDS:g} s, {states / SECONDS:.0f} states/s, {sent} references")
            print(f"memory grew by {grown / 1024:.0f} kB")
            print({name: value for name, value in last.items() if "[us]" in name or "rate" in name})
            assert grown < GROWTH
            assert last["references refused"] == "0" and last["states out of order"] == "0"
            messages = [message for _, message, _ in told_of[2:]]
            assert not [m for m in messages if "no reference" in m or "efforts go to zero" in m], messages
            answered = sum(float(values["efforts rate [1/s]"]) for _, _, values in told_of[2:]) / len(told_of[2:])
            assert answered > 0.9 * states / SECONDS
        finally:
            stand.close()
