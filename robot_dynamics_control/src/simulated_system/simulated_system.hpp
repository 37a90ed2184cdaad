// A simulated robot as a hardware component of ros2_control.

#ifndef ROBOT_DYNAMICS_CONTROL_SIMULATED_SYSTEM_HPP
#define ROBOT_DYNAMICS_CONTROL_SIMULATED_SYSTEM_HPP

#include <atomic>
#include <string>
#include <vector>

#include <hardware_interface/system_interface.hpp>

#include "rigid_body_simulation.hpp"
#include "robot_dynamics_control/model_library.hpp"

namespace robot_dynamics_control {

/// Moves the joints of a model under the efforts that controllers command, in real time.
///
/// Parameters of the component: `model_library`, as of the controller; `payload`, ten numbers of the inertia that the
/// robot carries. Brakes hold the robot while no controller has claimed an effort interface; else a joint without such
/// an interface moves freely. A gpio `simulation` may have a command interface `state_fault`: while it is 1, all
/// positions are nan, as a broken sensor would give.
///
/// It tries controllers, parameters and their switching. It has no joint stops, contacts, delays or noise.
class SimulatedSystem : public hardware_interface::SystemInterface {
public:
    hardware_interface::CallbackReturn on_init(
        const hardware_interface::HardwareComponentInterfaceParams& params) override;
    hardware_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State& previous_state) override;
    hardware_interface::return_type perform_command_mode_switch(
        const std::vector<std::string>& start_interfaces, const std::vector<std::string>& stop_interfaces) override;
    hardware_interface::return_type read(const rclcpp::Time& time, const rclcpp::Duration& period) override;
    hardware_interface::return_type write(const rclcpp::Time& time, const rclcpp::Duration& period) override;

private:
    std::string configure_simulation();
    std::string find_joints();
    void claim(const std::vector<std::string>& interfaces, bool is_claimed) noexcept;
    void write_state();

    struct Joint {
        std::string position;
        std::string velocity;
        std::string effort; // empty: without an interface
        bool has_effort_state = false;
        bool is_claimed = false;
    };

    ModelLibrary library_;
    RigidBodySimulation simulation_;
    std::vector<Joint> joints_; // in the order of the model
    std::vector<double> efforts_;
    bool has_fault_input_ = false;
    std::atomic<bool> brakes_are_closed_{true};
};

} // namespace robot_dynamics_control

#endif
