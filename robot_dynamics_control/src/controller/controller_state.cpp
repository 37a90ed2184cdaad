#include "controller_state.hpp"

#include <algorithm>
#include <limits>

namespace robot_dynamics_control {

ControllerStatePublisher::ControllerStatePublisher(
    rclcpp_lifecycle::LifecycleNode& node, const ControlLaw& law, double rate)
    : period_(static_cast<std::int64_t>(1e9 / rate))
{
    const std::size_t size = law.size();
    for (std::size_t i = 0; i < size; ++i) {
        message_.joint_names.emplace_back(law.joint_name(i));
    }
    for (auto* point : {&message_.reference, &message_.feedback, &message_.error}) {
        point->positions.resize(size);
        point->velocities.resize(size);
    }
    message_.reference.accelerations.resize(size);
    message_.output.effort.resize(size);
    publisher_ = node.create_publisher<Message>("~/controller_state", rclcpp::SystemDefaultsQoS());
    realtime_publisher_ = std::make_unique<realtime_tools::RealtimePublisher<Message>>(publisher_);
    realtime_publisher_->lock();
    realtime_publisher_->msg_ = message_; // of the size of all that follow, so that updates do not allocate
    realtime_publisher_->unlock();
}

void ControllerStatePublisher::update(const rclcpp::Time& time, const Law& law)
{
    const std::int64_t now = time.nanoseconds();
    if (now - last_ < period_ && now >= last_) {
        return;
    }
    // without a reference there is none to show, and no error
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const bool has_reference = law.activity() == Activity::feedforward || law.activity() == Activity::computed_torque
        || law.activity() == Activity::pd_gravity;
    const ControlLaw& control_law = law.control_law();
    const Motion reference = law.reference();
    for (std::size_t i = 0; i < law.size(); ++i) {
        const std::size_t joint = control_law.joint_index(i);
        message_.reference.positions[i] = has_reference ? reference.positions[i] : nan;
        message_.reference.velocities[i] = has_reference ? reference.velocities[i] : nan;
        message_.reference.accelerations[i] = has_reference ? reference.accelerations[i] : nan;
        message_.feedback.positions[i] = control_law.q()[joint];
        message_.feedback.velocities[i] = control_law.qd()[joint];
        message_.error.positions[i] = has_reference ? control_law.error()[i] : nan;
        message_.error.velocities[i] = has_reference ? control_law.rate_error()[i] : nan;
        message_.output.effort[i] = law.last_efforts()[i];
    }
    message_.header.stamp = time;
    if (realtime_publisher_->try_publish(message_)) {
        last_ = now;
    }
}

} // namespace robot_dynamics_control
