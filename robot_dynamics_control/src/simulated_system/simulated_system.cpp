#include "simulated_system.hpp"

#include <cmath>
#include <limits>
#include <sstream>

#include <hardware_interface/types/hardware_interface_type_values.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <rclcpp/logging.hpp>

namespace robot_dynamics_control {

using hardware_interface::CallbackReturn;
using hardware_interface::HW_IF_EFFORT;
using hardware_interface::HW_IF_POSITION;
using hardware_interface::HW_IF_VELOCITY;
using hardware_interface::return_type;

namespace {

constexpr char fault_interface[] = "simulation/state_fault";
constexpr double longest_step = 0.002; // [s] longer periods are divided

bool has_interface(const std::vector<hardware_interface::InterfaceInfo>& interfaces, const char* name)
{
    for (const auto& interface : interfaces) {
        if (interface.name == name) {
            return true;
        }
    }
    return false;
}

} // namespace

CallbackReturn SimulatedSystem::on_init(const hardware_interface::HardwareComponentInterfaceParams& params)
{
    if (hardware_interface::SystemInterface::on_init(params) != CallbackReturn::SUCCESS) {
        return CallbackReturn::ERROR;
    }
    const std::string error = configure_simulation();
    if (!error.empty()) {
        RCLCPP_ERROR(get_logger(), "%s", error.c_str());
        return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
}

std::string SimulatedSystem::configure_simulation()
{
    const auto& parameters = get_hardware_info().hardware_parameters;
    const auto path = parameters.find("model_library");
    if (path == parameters.end()) {
        return "the parameter model_library is missing: the shared object with the model of the robot";
    }
    std::string error = library_.open(path->second);
    if (error.empty()) {
        error = simulation_.configure(library_.model());
    }
    if (error.empty()) {
        error = find_joints();
    }
    const auto payload = parameters.find("payload");
    if (!error.empty() || payload == parameters.end()) {
        return error;
    }
    std::istringstream numbers(payload->second);
    for (double& value : simulation_.payload()) {
        if (!(numbers >> value)) {
            return "the parameter payload needs ten numbers: mass, first moments x y z, inertia xx xy xz yy yz zz";
        }
    }
    return library_.model().has_payload() ? "" : "the model has no payload: leave the parameter payload out";
}

std::string SimulatedSystem::find_joints()
{
    const Model& model = library_.model();
    joints_.assign(model.joint_count(), Joint{});
    efforts_.assign(model.joint_count(), 0.0);
    for (const auto& joint : get_hardware_info().joints) {
        const std::size_t index = model.find_joint(joint.name);
        if (index == model.joint_count()) {
            return "joint '" + joint.name + "' is no joint of the model of '" + model.robot() + "'";
        }
        if (!has_interface(joint.state_interfaces, HW_IF_POSITION)
            || !has_interface(joint.state_interfaces, HW_IF_VELOCITY)) {
            return "joint '" + joint.name + "' needs the state interfaces position and velocity";
        }
        Joint& found = joints_[index];
        found.position = joint.name + "/" + HW_IF_POSITION;
        found.velocity = joint.name + "/" + HW_IF_VELOCITY;
        found.effort = has_interface(joint.command_interfaces, HW_IF_EFFORT) ? joint.name + "/" + HW_IF_EFFORT : "";
        found.has_effort_state = !found.effort.empty() && has_interface(joint.state_interfaces, HW_IF_EFFORT);
    }
    for (std::size_t index = 0; index < joints_.size(); ++index) {
        if (joints_[index].position.empty()) {
            return std::string("joint '") + model.joint(index).name + "' of the model is missing";
        }
    }
    has_fault_input_ = false;
    for (const auto& gpio : get_hardware_info().gpios) {
        has_fault_input_ = has_fault_input_
            || (gpio.name == "simulation" && has_interface(gpio.command_interfaces, "state_fault"));
    }
    return "";
}

CallbackReturn SimulatedSystem::on_activate(const rclcpp_lifecycle::State&)
{
    for (std::size_t index = 0; index < joints_.size(); ++index) {
        const Joint& joint = joints_[index];
        // initial values of the description
        const double position = get_state(joint.position);
        const double velocity = get_state(joint.velocity);
        simulation_.q()[index] = std::isfinite(position) ? position : 0.0;
        simulation_.qd()[index] = std::isfinite(velocity) ? velocity : 0.0;
        efforts_[index] = 0.0;
    }
    write_state();
    return CallbackReturn::SUCCESS;
}

return_type SimulatedSystem::perform_command_mode_switch(
    const std::vector<std::string>& start_interfaces, const std::vector<std::string>& stop_interfaces)
{
    claim(stop_interfaces, false);
    claim(start_interfaces, true);
    bool is_held = true;
    for (const Joint& joint : joints_) {
        is_held = is_held && !joint.is_claimed;
    }
    brakes_are_closed_.store(is_held);
    return return_type::OK;
}

void SimulatedSystem::claim(const std::vector<std::string>& interfaces, bool is_claimed) noexcept
{
    for (Joint& joint : joints_) {
        for (const std::string& interface : interfaces) {
            joint.is_claimed = interface == joint.effort ? is_claimed : joint.is_claimed;
        }
    }
}

return_type SimulatedSystem::read(const rclcpp::Time&, const rclcpp::Duration& period)
{
    const double duration = period.seconds();
    if (!(duration > 0.0)) {
        return return_type::OK;
    }
    if (brakes_are_closed_.load()) {
        for (double& velocity : simulation_.qd()) {
            velocity = 0.0;
        }
        write_state();
        return return_type::OK;
    }
    const int count = static_cast<int>(std::ceil(duration / longest_step));
    for (int k = 0; k < count; ++k) {
        if (!simulation_.step(duration / count, efforts_)) {
            RCLCPP_ERROR(get_logger(), "the mass matrix of the model is not positive definite in this state");
            return return_type::ERROR;
        }
    }
    write_state();
    return return_type::OK;
}

return_type SimulatedSystem::write(const rclcpp::Time&, const rclcpp::Duration&)
{
    for (std::size_t index = 0; index < joints_.size(); ++index) {
        const double effort = joints_[index].effort.empty() ? 0.0 : get_command(joints_[index].effort);
        efforts_[index] = std::isfinite(effort) ? effort : 0.0;
    }
    return return_type::OK;
}

void SimulatedSystem::write_state()
{
    const bool has_fault = has_fault_input_ && get_command(fault_interface) == 1.0;
    for (std::size_t index = 0; index < joints_.size(); ++index) {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        set_state(joints_[index].position, has_fault ? nan : simulation_.q()[index]);
        set_state(joints_[index].velocity, simulation_.qd()[index]);
        if (joints_[index].has_effort_state) {
            set_state(joints_[index].effort, efforts_[index]);
        }
    }
}

} // namespace robot_dynamics_control

PLUGINLIB_EXPORT_CLASS(robot_dynamics_control::SimulatedSystem, hardware_interface::SystemInterface)
