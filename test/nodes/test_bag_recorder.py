"""What a Recorder writes is what was published, in a bag that others read."""

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.demo.bag_recorder import BagRecorder
from robot_dynamics.nodes.demo.closed_loop import open_bag_recorder

highlevel = pytest.importorskip("rosbags.highlevel", reason="rosbags, which writes bags, is not installed")


def test_messages_are_in_the_bag_as_they_were_published(client, tmp_path):
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
        found = [(c.topic, c.msgtype, time, reader.deserialize(data, c.msgtype)) for c, time, data in reader.messages()]
    assert [time for _, _, time, _ in found] == list(range(1_000, 1_020))
    for (topic, kind, _, message), told in zip(found, sent, strict=True):
        assert (topic, kind) == ("/recorded", "sensor_msgs/msg/JointState")
        assert message.name == list(told.name)
        np.testing.assert_array_equal(message.position, told.position)


def test_the_demo_writes_its_bags_anew_but_takes_no_other_folder_for_one(tmp_path):
    (tmp_path / "panda").mkdir()
    (tmp_path / "panda" / "thesis.txt").write_text("months of work")
    with pytest.raises(RobotDynamicsError, match="no bag of the demo"):
        open_bag_recorder(None, None, "/demo", tmp_path / "panda")
    assert (tmp_path / "panda" / "thesis.txt").exists()
