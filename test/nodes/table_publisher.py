"""Publish the rows of a CSV table as joint states: python table_publisher.py TABLE TOPIC SPEED [once]

Stamps are the times of the table after the start; SPEED rows pass in the time of one. The table is repeated, one step
after its last row, as often as needed. `once`: the process waits for a subscriber, publishes the table once, and ends.
"""

import csv
import sys
import time
from array import array

import rclpy
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

SIGNALS = ("position", "velocity", "effort")


def read_table(path):
    """Names of the joints, times of the rows [s], and {signal: values of each row}."""
    with open(path) as file:
        titles, *rows = list(csv.reader(file))
    numbers = [[float(cell) for cell in row] for row in rows]
    names = list(dict.fromkeys(title.partition(".")[0] for title in titles[1:]))
    columns = {signal: [titles.index(f"{name}.{signal}") for name in names] for signal in SIGNALS}
    values = {signal: [array("d", [row[k] for k in columns[signal]]) for row in numbers] for signal in SIGNALS}
    return names, [row[0] for row in numbers], values


def main(path, topic, speed, *options):
    names, times, values = read_table(path)
    period = times[-1] - times[0] + (times[1] - times[0])
    rclpy.init()
    node = rclpy.create_node("table_publisher")
    publisher = node.create_publisher(JointState, topic, QoSProfile(depth=1000))
    while "once" in options and not publisher.get_subscription_count():
        time.sleep(0.02)
    message = JointState(name=names)
    beginning = 1_700_000_000_000_000_000
    started = time.monotonic()
    cycle = 0
    while True:
        for row, at in enumerate(times):
            elapsed = cycle * period + at - times[0]
            time.sleep(max(0.0, started + elapsed / float(speed) - time.monotonic()))
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(beginning + round(elapsed * 1e9), 10**9)
            message.position, message.velocity, message.effort = (values[signal][row] for signal in SIGNALS)
            publisher.publish(message)
        cycle += 1
        if "once" in options:
            time.sleep(0.5)  # the middleware sends the last messages
            break
    rclpy.shutdown()


if __name__ == "__main__":
    main(*sys.argv[1:])
