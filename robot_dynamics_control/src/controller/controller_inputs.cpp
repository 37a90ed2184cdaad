#include "controller_inputs.hpp"

#include <algorithm>
#include <cmath>

namespace robot_dynamics_control {

namespace {

std::vector<double> expand_to_joints(const std::vector<double>& values, std::size_t size)
{
    return values.size() == 1 ? std::vector<double>(size, values.front()) : values;
}

std::string find_objection_to_size(const std::string& name, std::size_t count, bool may_be_one, const ControlLaw& law)
{
    if (count == law.size() || (may_be_one && count == 1)) {
        return "";
    }
    std::string joints;
    for (std::size_t i = 0; i < law.size(); ++i) {
        joints += std::string(i == 0 ? "" : ", ") + law.joint_name(i);
    }
    return "parameter " + name + " has " + std::to_string(count) + " values: " + std::to_string(law.size())
        + " are needed, one for each of " + joints;
}

bool is_zero(const rclcpp::Parameter& parameter)
{
    if (parameter.get_type() == rclcpp::ParameterType::PARAMETER_DOUBLE) {
        return parameter.as_double() == 0.0;
    }
    const std::vector<double> values = parameter.as_double_array();
    return std::all_of(values.begin(), values.end(), [](double value) { return value == 0.0; });
}

} // namespace

Settings settings_from_parameters(const ControllerParameters& parameters, std::size_t size)
{
    Settings settings;
    parse(parameters.mode, settings.mode);
    parse(parameters.without_reference, settings.without_reference);
    parse(parameters.friction_velocity, settings.friction_velocity);
    settings.kp = expand_to_joints(parameters.kp, size);
    settings.kd = expand_to_joints(parameters.kd, size);
    settings.limits = parameters.effort_limits;
    settings.state_timeout = parameters.state_timeout;
    settings.reference_timeout = parameters.reference_timeout;
    settings.ramp_time = parameters.ramp_time;
    return settings;
}

StartEfforts start_efforts_from_name(const std::string& name)
{
    if (name == "command") {
        return StartEfforts::command;
    }
    return name == "gravity" ? StartEfforts::gravity : StartEfforts::zero;
}

std::array<double, ROBOT_DYNAMICS_INERTIA_SIZE> payload_from_parameters(const ControllerParameters& parameters)
{
    const auto& second_moments = parameters.payload.inertia;
    auto inertia = point_mass(parameters.payload.mass, parameters.payload.first_moments.data());
    if (std::any_of(second_moments.begin(), second_moments.end(), [](double moment) { return moment != 0.0; })) {
        std::copy_n(second_moments.begin(), 6, inertia.begin() + 4);
    }
    return inertia;
}

std::string find_objection_to_parameter(
    const rclcpp::Parameter& parameter, const ControlLaw& law, unsigned update_rate)
{
    const std::string& name = parameter.get_name();
    if (parameter.get_type() == rclcpp::ParameterType::PARAMETER_DOUBLE && !std::isfinite(parameter.as_double())) {
        return "parameter " + name + " is not finite";
    }
    if (parameter.get_type() == rclcpp::ParameterType::PARAMETER_DOUBLE_ARRAY) {
        for (const double value : parameter.as_double_array()) {
            if (std::isnan(value) || (std::isinf(value) && name != "effort_limits")) {
                return "parameter " + name + " has a number that is not finite";
            }
        }
    }
    const bool is_gain = name == "kp" || name == "kd";
    if (is_gain || name == "effort_limits") {
        const std::size_t count = parameter.as_double_array().size();
        const bool is_left_out = count == 0 && !is_gain;
        const std::string objection = is_left_out ? "" : find_objection_to_size(name, count, is_gain, law);
        if (objection.empty() && !is_gain && !is_left_out && is_zero(parameter)) {
            return "parameter effort_limits: all efforts are limited to 0, so that nothing but zeros could be sent";
        }
        return objection;
    }
    if (name == "state_timeout" && update_rate > 0 && parameter.as_double() * update_rate <= 2.0) {
        return "parameter state_timeout is " + std::to_string(parameter.as_double()) + " s: a time above two periods of "
            + std::to_string(update_rate) + " updates a second, " + std::to_string(2.0 / update_rate)
            + " s, is needed, else each pause is a stall";
    }
    if (name.rfind("payload.", 0) == 0 && !law.model().has_payload() && !is_zero(parameter)) {
        return "parameter " + name + ": the model of '" + law.model().robot()
            + "' carries no payload; build it with robot_dynamics_generate(... PAYLOAD <frame>)";
    }
    return "";
}

} // namespace robot_dynamics_control
