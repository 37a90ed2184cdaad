// The topic ~/controller_state.

#ifndef ROBOT_DYNAMICS_CONTROL_CONTROLLER_STATE_HPP
#define ROBOT_DYNAMICS_CONTROL_CONTROLLER_STATE_HPP

#include <cstdint>
#include <memory>

#include <control_msgs/msg/joint_trajectory_controller_state.hpp>
#include <rclcpp/time.hpp>
#include <rclcpp_lifecycle/lifecycle_node.hpp>
#include <realtime_tools/realtime_publisher.hpp>

#include "robot_dynamics_control/law.hpp"

namespace robot_dynamics_control {

/// Publishes reference, feedback, error and output of a law, by a thread of its own.
class ControllerStatePublisher {
public:
    /// rate: maximum number of messages a second.
    ControllerStatePublisher(rclcpp_lifecycle::LifecycleNode& node, const ControlLaw& law, double rate);

    /// Publish unless the last message is too recent, or is still being sent. For the update loop.
    void update(const rclcpp::Time& time, const Law& law);

private:
    using Message = control_msgs::msg::JointTrajectoryControllerState;

    std::int64_t period_; // [ns]
    std::int64_t last_ = 0; // [ns] time of the last message
    Message message_;
    rclcpp::Publisher<Message>::SharedPtr publisher_;
    std::unique_ptr<realtime_tools::RealtimePublisher<Message>> realtime_publisher_;
};

} // namespace robot_dynamics_control

#endif
