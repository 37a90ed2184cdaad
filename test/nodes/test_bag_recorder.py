"""A BagRecorder writes messages as they were published, in a bag that other tools read."""

import time

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.demo.bag_recorder import BagRecorder
from robot_dynamics.nodes.demo.closed_loop import open_bag_recorder

highlevel = pytest.importorskip("rosbags.highlevel", reason="rosbags, which writes bags, is not installed")


def test_bag_recorder_writes_messages_as_they_were_published(client, tmp_path):
    path, stamps = tmp_path / "bag", iter(range(1_000, 10_000))
    publisher = client.node.create_publisher(JointState, "recorded", 100)
    sent = [JointState(name=["a", "b"], position=[float(k), -k / 3]) for k in range(20)]
    with BagRecorder(client.node, path, {"/recorded": JointState}, lambda: next(stamps)) as recorder:
        for _ in range(200):
            if publisher.get_subscription_count():
                break
            client.spin(0.02)
        for message in sent:
            publisher.publish(message)
        for _ in range(200):
            if recorder.message_count == len(sent):
                break
            client.spin(0.02)
    assert sorted(file.suffix for file in path.iterdir()) == [".mcap", ".yaml"]
    with highlevel.AnyReader([path]) as reader:
        recorded_messages = [
            (c.topic, c.msgtype, time, reader.deserialize(data, c.msgtype)) for c, time, data in reader.messages()
        ]
    assert [time for _, _, time, _ in recorded_messages] == list(range(1_000, 1_020))
    for (topic, kind, _, message), expected in zip(recorded_messages, sent, strict=True):
        assert (topic, kind) == ("/recorded", "sensor_msgs/msg/JointState")
        assert message.name == list(expected.name)
        np.testing.assert_array_equal(message.position, expected.position)


def test_messages_that_wait_when_the_recording_ends_are_dropped(client, tmp_path):
    publisher = client.node.create_publisher(JointState, "recorded", 100)
    with BagRecorder(client.node, tmp_path / "bag", {"/recorded": JointState}, lambda: 1_000) as recorder:
        while not recorder.message_count:
            publisher.publish(JointState())
            client.spin(0.01)
        for _ in range(50):
            publisher.publish(JointState())
        time.sleep(0.2)
        client.spin(0.0001)  # one of them
        count = recorder.message_count
    client.spin(0.2)
    assert recorder.message_count == count


def test_demo_replaces_its_bags_but_no_other_folder(tmp_path):
    (tmp_path / "panda").mkdir()
    (tmp_path / "panda" / "thesis.txt").write_text("months of work")
    with pytest.raises(RobotDynamicsError, match="no bag of the demo"):
        open_bag_recorder(None, None, "/demo", tmp_path / "panda")
    assert (tmp_path / "panda" / "thesis.txt").exists()
