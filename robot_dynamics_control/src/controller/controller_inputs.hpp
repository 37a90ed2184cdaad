// What other threads give to the update loop: settings and payload, from parameters that were checked.

#ifndef ROBOT_DYNAMICS_CONTROL_CONTROLLER_INPUTS_HPP
#define ROBOT_DYNAMICS_CONTROL_CONTROLLER_INPUTS_HPP

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <rclcpp/parameter.hpp>

#include "robot_dynamics_control/computed_torque_controller_parameters.hpp"
#include "robot_dynamics_control/law.hpp"

namespace robot_dynamics_control {

using ControllerParameters = computed_torque_controller::Params;

/// Efforts from which those of the mode are reached after activation.
enum class StartEfforts { zero, command, gravity };

/// Settings and payload, and a number that counts up with each change.
struct ControllerInputs {
    Settings settings;
    std::array<double, ROBOT_DYNAMICS_INERTIA_SIZE> payload{};
    bool error_on_fault = false;
    StartEfforts start_efforts = StartEfforts::zero;
    std::uint64_t revision = 0;
};

/// A point of ~/reference_point in the order of the controlled joints, and a number that counts up with each point.
struct ReferenceInput {
    std::vector<double> positions;
    std::vector<double> velocities;
    std::vector<double> accelerations;
    std::uint64_t revision = 0;
};

/// The settings of parameters, for `size` joints. An array of one number is expanded to all joints.
Settings settings_from_parameters(const ControllerParameters& parameters, std::size_t size);

/// The start efforts of a name that the parameter may have.
StartEfforts start_efforts_from_name(const std::string& name);

/// The inertia (10) of the payload of parameters.
std::array<double, ROBOT_DYNAMICS_INERTIA_SIZE> payload_from_parameters(const ControllerParameters& parameters);

/// What is wrong with a parameter for the joints of a law that is updated `update_rate` times a second; empty where
/// nothing is.
std::string find_objection_to_parameter(
    const rclcpp::Parameter& parameter, const ControlLaw& law, unsigned update_rate);

} // namespace robot_dynamics_control

#endif
