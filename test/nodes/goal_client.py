"""A client of FollowJointTrajectory, written to the documented behaviour of MoveIt's simple controller manager.

It sends one goal at a time, waits for its acceptance and then for its result without a time limit of its own, takes a
goal that was aborted or cancelled for a failed motion, and reports the error code and text of the result. Before it
stops a motion it asks the server to cancel the goal.
"""

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

SUCCEEDED, ABORTED, CANCELED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_ABORTED, GoalStatus.STATUS_CANCELED


class Sent:
    """A goal that was sent: futures of its handle and result, and the feedback so far."""

    def __init__(self):
        self.feedback = []
        self.accepted = self.result_future = None

    @property
    def is_answered(self):
        return self.accepted.done()

    @property
    def is_done(self):
        return self.result_future is not None and self.result_future.done()

    @property
    def status(self):
        return self.result_future.result().status

    @property
    def result(self):
        return self.result_future.result().result


class GoalClient:
    """Sends goals to the node of a ControllerProbe, whose thread spins."""

    def __init__(self, probe, kind):
        self.kind, self._probe = kind, probe
        self._client = ActionClient(probe.node, kind, f"{probe.target}/follow_joint_trajectory")
        assert self._client.wait_for_server(20.0), "no action server"

    def send(self, trajectory, **fields):
        """Send a goal while states are published, until the server has answered."""
        sent = Sent()
        goal = self.kind.Goal(trajectory=trajectory, **fields)
        sent.accepted = self._client.send_goal_async(goal, lambda message: sent.feedback.append(message.feedback))
        return sent

    def start(self, trajectory, q, **fields):
        """Send a goal that is accepted, while states are published."""
        sent = self.send(trajectory, **fields)
        self._probe.stream_until(lambda: sent.is_answered, "answer", q=q)
        handle = sent.accepted.result()
        assert handle.accepted, "the goal was rejected"
        sent.result_future = handle.get_result_async()
        return sent
