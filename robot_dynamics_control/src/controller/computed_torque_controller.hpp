// The control laws as a plugin of ros2_control.

#ifndef ROBOT_DYNAMICS_CONTROL_COMPUTED_TORQUE_CONTROLLER_HPP
#define ROBOT_DYNAMICS_CONTROL_COMPUTED_TORQUE_CONTROLLER_HPP

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <controller_interface/chainable_controller_interface.hpp>
#include <rclcpp/rclcpp.hpp>
#include <realtime_tools/realtime_buffer.hpp>
#include <trajectory_msgs/msg/joint_trajectory.hpp>

#include "activity_report.hpp"
#include "controller_inputs.hpp"
#include "controller_state.hpp"
#include "robot_dynamics_control/law.hpp"
#include "robot_dynamics_control/model_library.hpp"

namespace robot_dynamics_control {

/// Writes the efforts of `Law` to the effort interfaces of the controlled joints, in each update.
///
/// It reads the position and velocity interfaces of all joints of the model. The model is a shared object, which is
/// loaded at configuration. References come from the controller before it in a chain, by the interfaces
/// <name>/<joint>/position, velocity and acceleration, else from the topic ~/reference_point. A reference is used once:
/// `update` sets its interfaces to nan, so that a controller that no longer writes is noticed.
///
/// Updates allocate nothing and wait for no other thread. What they do is logged by a timer.
class ComputedTorqueController : public controller_interface::ChainableControllerInterface {
public:
    controller_interface::CallbackReturn on_init() override;
    controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State& previous_state) override;
    controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State& previous_state) override;
    controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous_state) override;
    controller_interface::CallbackReturn on_cleanup(const rclcpp_lifecycle::State& previous_state) override;

    controller_interface::InterfaceConfiguration command_interface_configuration() const override;
    controller_interface::InterfaceConfiguration state_interface_configuration() const override;

protected:
    std::vector<hardware_interface::CommandInterface::SharedPtr> on_export_reference_interfaces_list() override;
    controller_interface::return_type update_reference_from_subscribers(
        const rclcpp::Time& time, const rclcpp::Duration& period) override;
    controller_interface::return_type update_and_write_commands(
        const rclcpp::Time& time, const rclcpp::Duration& period) override;

private:
    using JointTrajectory = trajectory_msgs::msg::JointTrajectory;

    bool is_configured() const { return law_.size() > 0; }
    std::string configure_law(const std::vector<rclcpp::Parameter>& checked);
    void prepare();
    void watch_parameters();
    void write_inputs();
    void on_reference_point(const JointTrajectory& message);
    std::string read_point(const JointTrajectory& message, ReferenceInput& input) const;

    // of the update loop
    double seconds(const rclcpp::Time& time) noexcept;
    void apply_inputs();
    void track_reference_interfaces(double now);
    void track(double now, const Motion& point) noexcept;
    bool read_state();
    void write_efforts(Numbers efforts);
    bool has_ended_by_fault() const noexcept;

    void clear_reference_interfaces();
    void start_law();
    void write_start_efforts(MutableNumbers efforts);
    void release();

    std::shared_ptr<computed_torque_controller::ParamListener> parameter_listener_;
    ControllerParameters parameters_; // those of the configuration
    ModelLibrary library_;
    Law law_;

    std::array<double, ROBOT_DYNAMICS_INERTIA_SIZE> payload_{}; // the last one that a body can have
    realtime_tools::RealtimeBuffer<ControllerInputs> inputs_;
    std::uint64_t input_revision_ = 0; // of the inputs that the law has
    std::uint64_t written_revision_ = 0;
    bool error_on_fault_ = false;
    StartEfforts start_efforts_ = StartEfforts::zero;

    realtime_tools::RealtimeBuffer<ReferenceInput> reference_input_;
    std::uint64_t reference_revision_ = 0;
    std::uint64_t received_points_ = 0;
    std::vector<hardware_interface::CommandInterface::SharedPtr> reference_interfaces_list_; // positions first
    std::vector<double> positions_;
    std::vector<double> velocities_;
    std::vector<double> accelerations_;

    std::optional<std::int64_t> origin_; // [ns] time of the first update
    std::optional<std::chrono::steady_clock::time_point> deactivated_at_;

    std::mutex configuration_mutex_; // of what callbacks beside the update loop read; the loop does not lock it
    ActivityReport report_;
    std::unique_ptr<ControllerStatePublisher> state_publisher_;
    rclcpp::Subscription<JointTrajectory>::SharedPtr point_subscription_;
    rclcpp::node_interfaces::OnSetParametersCallbackHandle::SharedPtr on_set_parameters_;
    rclcpp::node_interfaces::PostSetParametersCallbackHandle::SharedPtr post_set_parameters_;
    rclcpp::TimerBase::SharedPtr report_timer_;
};

} // namespace robot_dynamics_control

#endif
