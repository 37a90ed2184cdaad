#include "computed_torque_controller.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <thread>
#include <tuple>

#include <hardware_interface/types/hardware_interface_type_values.hpp>
#include <pluginlib/class_list_macros.hpp>

namespace robot_dynamics_control {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;
using hardware_interface::HW_IF_ACCELERATION;
using hardware_interface::HW_IF_EFFORT;
using hardware_interface::HW_IF_POSITION;
using hardware_interface::HW_IF_VELOCITY;

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr std::chrono::milliseconds report_period{100};

/// Parameters whose validity depends on the model or on other numbers.
const std::vector<std::string> checked_parameters{"kp", "kd", "effort_limits", "ramp_time", "state_timeout",
    "reference_timeout", "payload.mass", "payload.first_moments", "payload.inertia"};

bool is_checked(const std::string& name)
{
    return std::find(checked_parameters.begin(), checked_parameters.end(), name) != checked_parameters.end();
}

template <typename Interface>
bool are_in_order(const std::vector<Interface>& interfaces, const InterfaceConfiguration& configuration)
{
    return std::equal(interfaces.begin(), interfaces.end(), configuration.names.begin(), configuration.names.end(),
        [](const Interface& interface, const std::string& name) { return interface.get_name() == name; });
}

} // namespace

CallbackReturn ComputedTorqueController::on_init()
{
    try {
        parameter_listener_ = std::make_shared<computed_torque_controller::ParamListener>(get_node());
    } catch (const std::exception& error) {
        RCLCPP_ERROR(get_node()->get_logger(), "a parameter is wrong: %s", error.what());
        return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
}

CallbackReturn ComputedTorqueController::on_configure(const rclcpp_lifecycle::State&)
{
    release();
    // who sets parameters holds the lock of the node while the callbacks take that of the configuration: outside of them
    // the lock of the node is never taken inside the other one
    const std::vector<rclcpp::Parameter> checked = get_node()->get_parameters(checked_parameters);
    {
        const std::lock_guard<std::mutex> lock(configuration_mutex_);
        parameters_ = parameter_listener_->get_params();
        const std::string error = configure_law(checked);
        if (!error.empty()) {
            RCLCPP_ERROR(get_node()->get_logger(), "%s", error.c_str());
            return CallbackReturn::ERROR;
        }
        prepare();
    }
    watch_parameters();
    const std::lock_guard<std::mutex> lock(configuration_mutex_);
    write_inputs(); // once more: parameters may have changed in between
    return CallbackReturn::SUCCESS;
}

void ComputedTorqueController::prepare()
{
    const ControlLaw& law = law_.control_law();
    for (auto* values : {&positions_, &velocities_, &accelerations_}) {
        values->assign(law.size(), 0.0);
    }
    reference_input_.initRT(ReferenceInput{positions_, velocities_, accelerations_, 0});
    reference_revision_ = received_points_ = 0;
    written_revision_ = input_revision_ = 0;
    write_inputs();
    report_.restart();
    report_timer_ = get_node()->create_wall_timer(report_period, [this] {
        const std::lock_guard<std::mutex> timer_lock(configuration_mutex_);
        report_.log(get_node()->get_logger(), law_.control_law());
    });
    point_subscription_ = get_node()->create_subscription<JointTrajectory>(
        "~/reference_point", rclcpp::SensorDataQoS(), [this](const JointTrajectory& message) {
            const std::lock_guard<std::mutex> point_lock(configuration_mutex_);
            if (is_configured()) {
                on_reference_point(message);
            }
        });
    if (parameters_.state_rate > 0.0) {
        state_publisher_ = std::make_unique<ControllerStatePublisher>(*get_node(), law, parameters_.state_rate);
    }
    origin_.reset();
    deactivated_at_.reset();
    RCLCPP_INFO(get_node()->get_logger(), "robot '%s', %zu joints, model by %s", law.model().robot().c_str(),
        law.size(), law.model().table().generator);
}

std::string ComputedTorqueController::configure_law(const std::vector<rclcpp::Parameter>& checked)
{
    std::string error = library_.open(parameters_.model_library);
    if (!error.empty()) {
        return error;
    }
    if (library_.model().has_moving_base()) {
        return "the base of '" + library_.model().robot() + "' moves, and this controller does not read its motion: "
            "generate the model with OPTIONS --base fixed, or use the node computed_torque";
    }
    ControlLaw law;
    error = law.configure(library_.model(), parameters_.joints);
    if (!error.empty()) {
        return error;
    }
    for (const rclcpp::Parameter& parameter : checked) {
        error = find_objection_to_parameter(parameter, law, get_update_rate());
        if (!error.empty()) {
            return error;
        }
    }
    payload_ = payload_from_parameters(parameters_);
    error = find_objection_to_payload(payload_);
    if (!error.empty()) {
        return "parameters payload.*: " + error;
    }
    return law_.configure(library_.model(), parameters_.joints, settings_from_parameters(parameters_, law.size()));
}

void ComputedTorqueController::watch_parameters()
{
    on_set_parameters_ = get_node()->add_on_set_parameters_callback([this](const auto& parameters) {
        const std::lock_guard<std::mutex> lock(configuration_mutex_);
        rcl_interfaces::msg::SetParametersResult result;
        for (const rclcpp::Parameter& parameter : parameters) {
            if (is_configured() && is_checked(parameter.get_name()) && result.reason.empty()) {
                result.reason = find_objection_to_parameter(parameter, law_.control_law(), get_update_rate());
            }
        }
        result.successful = result.reason.empty();
        return result;
    });
    post_set_parameters_ = get_node()->add_post_set_parameters_callback([this](const auto&) {
        const std::lock_guard<std::mutex> lock(configuration_mutex_);
        if (is_configured()) { // otherwise it was released while this callback waited
            write_inputs();
        }
    });
}

void ComputedTorqueController::write_inputs()
{
    const ControllerParameters parameters = parameter_listener_->get_params();
    ControllerInputs inputs;
    inputs.settings = Law::complete(settings_from_parameters(parameters, law_.size()), law_.control_law());
    const auto payload = payload_from_parameters(parameters);
    const std::string objection = find_objection_to_payload(payload);
    if (objection.empty()) {
        payload_ = payload;
    } else { // they are set one after the other, in any order
        RCLCPP_WARN(get_node()->get_logger(), "the payload before stays in force until payload.* are those of a body: %s",
            objection.c_str());
    }
    inputs.payload = payload_;
    inputs.error_on_fault = parameters.error_on_fault;
    inputs.start_efforts = start_efforts_from_name(parameters.start_efforts);
    inputs.revision = ++written_revision_;
    inputs_.writeFromNonRT(inputs);
}

void ComputedTorqueController::on_reference_point(const JointTrajectory& message)
{
    ReferenceInput input;
    const std::string error = read_point(message, input);
    if (!error.empty()) {
        RCLCPP_WARN_THROTTLE(get_node()->get_logger(), *get_node()->get_clock(), 1000, "~/reference_point: %s",
            error.c_str());
        return;
    }
    input.revision = ++received_points_;
    reference_input_.writeFromNonRT(input);
}

std::string ComputedTorqueController::read_point(const JointTrajectory& message, ReferenceInput& input) const
{
    const ControlLaw& law = law_.control_law();
    if (message.points.size() != 1) {
        return "a message has " + std::to_string(message.points.size()) + " points: one is needed";
    }
    const auto& point = message.points.front();
    const std::size_t count = message.joint_names.size();
    const auto fits = [count](const std::vector<double>& values, bool may_be_empty) {
        return values.size() == count || (may_be_empty && values.empty());
    };
    if (!fits(point.positions, false) || !fits(point.velocities, true) || !fits(point.accelerations, true)) {
        return "positions, velocities and accelerations need one number for each of joint_names; the last two may be "
               "empty";
    }
    for (std::size_t i = 0; i < law.size(); ++i) {
        const auto found = std::find(message.joint_names.begin(), message.joint_names.end(), law.joint_name(i));
        if (found == message.joint_names.end()) {
            return std::string("joint_names lacks '") + law.joint_name(i) + "'";
        }
        const auto index = static_cast<std::size_t>(found - message.joint_names.begin());
        input.positions.push_back(point.positions[index]);
        input.velocities.push_back(point.velocities.empty() ? 0.0 : point.velocities[index]);
        input.accelerations.push_back(point.accelerations.empty() ? 0.0 : point.accelerations[index]);
    }
    return count == law.size() ? "" : "joint_names has joints that are not controlled, or a name twice";
}

CallbackReturn ComputedTorqueController::on_activate(const rclcpp_lifecycle::State&)
{
    if (!are_in_order(command_interfaces_, command_interface_configuration())
        || !are_in_order(state_interfaces_, state_interface_configuration())) {
        RCLCPP_ERROR(get_node()->get_logger(), "the interfaces are not those that were requested, in their order");
        return CallbackReturn::ERROR;
    }
    clear_reference_interfaces();
    reference_revision_ = reference_input_.readFromRT()->revision; // points before the activation are not used
    apply_inputs();
    start_law();
    write_efforts(law_.last_efforts());
    return CallbackReturn::SUCCESS;
}

void ComputedTorqueController::start_law()
{
    // The controller manager restarts a controller when another one is chained before it, or no longer is.
    const auto timeout = std::chrono::duration<double>(law_.settings().state_timeout);
    if (deactivated_at_ && std::chrono::steady_clock::now() - *deactivated_at_ < timeout) {
        law_.end_reference();
        law_.start_transition(); // the next reference may be far from the last one
        return;
    }
    write_start_efforts(positions_);
    law_.restart(positions_);
    if (read_state()) {
        law_.control_law().close_loops();
    }
}

void ComputedTorqueController::write_start_efforts(MutableNumbers efforts)
{
    std::fill(efforts.begin(), efforts.end(), 0.0);
    if (start_efforts_ == StartEfforts::command) {
        for (std::size_t i = 0; i < efforts.size(); ++i) {
            const double effort = command_interfaces_[i].get_optional().value_or(0.0);
            efforts[i] = std::isfinite(effort) ? effort : 0.0;
        }
    } else if (start_efforts_ == StartEfforts::gravity && read_state()) {
        if (!law_.control_law().gravity_compensation(efforts) || !all_finite(efforts)) {
            std::fill(efforts.begin(), efforts.end(), 0.0);
        }
    }
}

CallbackReturn ComputedTorqueController::on_deactivate(const rclcpp_lifecycle::State&)
{
    for (auto& interface : command_interfaces_) {
        if (!interface.set_value(0.0)) {
            RCLCPP_WARN(get_node()->get_logger(), "%s is in use, and keeps its last value",
                interface.get_name().c_str());
        }
    }
    deactivated_at_ = std::chrono::steady_clock::now();
    return CallbackReturn::SUCCESS;
}

CallbackReturn ComputedTorqueController::on_cleanup(const rclcpp_lifecycle::State&)
{
    release();
    return CallbackReturn::SUCCESS;
}

void ComputedTorqueController::release()
{
    const std::lock_guard<std::mutex> lock(configuration_mutex_);
    report_timer_.reset();
    point_subscription_.reset();
    on_set_parameters_.reset();
    post_set_parameters_.reset();
    state_publisher_.reset();
    reference_interfaces_list_.clear();
    law_ = Law();
    library_.close();
}

InterfaceConfiguration ComputedTorqueController::command_interface_configuration() const
{
    InterfaceConfiguration configuration{controller_interface::interface_configuration_type::INDIVIDUAL, {}};
    for (std::size_t i = 0; i < law_.size(); ++i) {
        configuration.names.push_back(std::string(law_.control_law().joint_name(i)) + "/" + HW_IF_EFFORT);
    }
    return configuration;
}

InterfaceConfiguration ComputedTorqueController::state_interface_configuration() const
{
    InterfaceConfiguration configuration{controller_interface::interface_configuration_type::INDIVIDUAL, {}};
    const Model& model = law_.control_law().model();
    for (const char* interface : {HW_IF_POSITION, HW_IF_VELOCITY}) {
        for (std::size_t joint = 0; model.is_bound() && joint < model.joint_count(); ++joint) {
            if (!law_.control_law().is_spring(joint)) {
                configuration.names.push_back(std::string(model.joint(joint).name) + "/" + interface);
            }
        }
    }
    return configuration;
}

std::vector<hardware_interface::CommandInterface::SharedPtr>
ComputedTorqueController::on_export_reference_interfaces_list()
{
    reference_interfaces_list_.clear();
    for (const char* interface : {HW_IF_POSITION, HW_IF_VELOCITY, HW_IF_ACCELERATION}) {
        for (std::size_t i = 0; i < law_.size(); ++i) {
            const std::string prefix = std::string(get_node()->get_name()) + "/" + law_.control_law().joint_name(i);
            reference_interfaces_list_.push_back(
                std::make_shared<hardware_interface::CommandInterface>(prefix, interface));
        }
    }
    clear_reference_interfaces();
    return reference_interfaces_list_;
}

void ComputedTorqueController::clear_reference_interfaces()
{
    for (const auto& interface : reference_interfaces_list_) {
        for (int attempt = 0; attempt < 10 && !interface->set_value(nan); ++attempt) {
            std::this_thread::yield(); // another thread reads it at this moment
        }
    }
}

return_type ComputedTorqueController::update_reference_from_subscribers(
    const rclcpp::Time& time, const rclcpp::Duration&)
{
    const ReferenceInput& input = *reference_input_.readFromRT();
    if (input.revision != reference_revision_) {
        reference_revision_ = input.revision;
        track(seconds(time), {input.positions, input.velocities, input.accelerations});
    }
    return return_type::OK;
}

return_type ComputedTorqueController::update_and_write_commands(const rclcpp::Time& time, const rclcpp::Duration&)
{
    const double now = seconds(time);
    apply_inputs();
    // also out of chained mode: where the controller before this one is restarted by one switch, ros2_control (4.46) takes
    // this one out of chained mode, and the other one goes on to write the interfaces
    track_reference_interfaces(now);
    const Numbers efforts = read_state() ? law_.step(now) : law_.tick(now); // a state that is in use is not new
    write_efforts(efforts.empty() ? law_.last_efforts() : efforts);
    report_.record(law_);
    if (state_publisher_) {
        state_publisher_->update(time, law_);
    }
    return error_on_fault_ && has_ended_by_fault() ? return_type::ERROR : return_type::OK;
}

double ComputedTorqueController::seconds(const rclcpp::Time& time) noexcept
{
    if (!origin_) {
        origin_ = time.nanoseconds();
    }
    return 1e-9 * static_cast<double>(time.nanoseconds() - *origin_);
}

void ComputedTorqueController::apply_inputs()
{
    const ControllerInputs& inputs = *inputs_.readFromRT();
    if (inputs.revision == input_revision_) {
        return;
    }
    input_revision_ = inputs.revision;
    law_.apply(inputs.settings);
    law_.set_payload(inputs.payload);
    error_on_fault_ = inputs.error_on_fault;
    start_efforts_ = inputs.start_efforts;
}

void ComputedTorqueController::track_reference_interfaces(double now)
{
    const std::size_t size = law_.size();
    bool is_complete = true;
    const auto take = [&](std::size_t index, double unspecified) {
        const double value = reference_interfaces_list_[index]->get_optional().value_or(nan);
        if (!std::isnan(value)) {
            // where another thread reads the interface, the value is used once more: it is one update old
            std::ignore = reference_interfaces_list_[index]->set_value(nan);
            return value;
        }
        is_complete = is_complete && !std::isnan(unspecified);
        return unspecified;
    };
    for (std::size_t i = 0; i < size; ++i) {
        positions_[i] = take(i, nan);
        velocities_[i] = take(size + i, 0.0);
        accelerations_[i] = take(2 * size + i, 0.0);
    }
    if (is_complete) {
        track(now, {positions_, velocities_, accelerations_});
    }
}

void ComputedTorqueController::track(double now, const Motion& point) noexcept
{
    const PointResult result = law_.track_point(now, now, point);
    if (result != PointResult::accepted) {
        report_.record_refusal(result, law_.offending_joint());
    }
}

bool ComputedTorqueController::read_state()
{
    MutableNumbers q = law_.control_law().q();
    MutableNumbers qd = law_.control_law().qd();
    bool is_complete = true;
    std::size_t index = 0;
    for (MutableNumbers values : {q, qd}) { // in the order of state_interface_configuration
        for (std::size_t joint = 0; joint < values.size(); ++joint) {
            if (law_.control_law().is_spring(joint)) {
                continue;
            }
            const std::optional<double> read_value = state_interfaces_[index++].get_optional();
            is_complete = is_complete && read_value.has_value();
            values[joint] = read_value.value_or(values[joint]); // in use by another thread: that of the last update
        }
    }
    return is_complete;
}

void ComputedTorqueController::write_efforts(Numbers efforts)
{
    for (std::size_t i = 0; i < efforts.size(); ++i) {
        std::ignore = command_interfaces_[i].set_value(efforts[i]); // where it fails, the next update writes
    }
}

bool ComputedTorqueController::has_ended_by_fault() const noexcept
{
    const Numbers efforts = law_.last_efforts();
    return law_.fault() != Fault::none
        && std::all_of(efforts.begin(), efforts.end(), [](double effort) { return effort == 0.0; });
}

} // namespace robot_dynamics_control

PLUGINLIB_EXPORT_CLASS(
    robot_dynamics_control::ComputedTorqueController, controller_interface::ChainableControllerInterface)
