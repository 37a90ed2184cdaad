#include "activity_report.hpp"

#include <rclcpp/logging.hpp>

namespace robot_dynamics_control {

namespace {

const char* describe(NoReference reason)
{
    switch (reason) {
    case NoReference::none: return "";
    case NoReference::none_yet: return "there is none yet";
    case NoReference::ended: return "it was ended";
    case NoReference::timed_out: return "none came for longer than reference_timeout";
    case NoReference::dropped: return "efforts went to zero for longer than ramp_time";
    }
    return "";
}

const char* describe(PointResult result)
{
    switch (result) {
    case PointResult::accepted: return "";
    case PointResult::wrong_size: return "it has not one number for each joint";
    case PointResult::not_finite: return "it has a number that is not finite";
    case PointResult::too_old: return "it is older than reference_timeout";
    case PointResult::ahead: return "it is ahead of the clock by more than reference_timeout";
    case PointResult::beyond_limits: return "a position is beyond the limits of the robot's description";
    }
    return "";
}

} // namespace

void ActivityReport::restart() noexcept
{
    activity_.store(Activity::none);
    fault_.store(Fault::none);
    refusal_.store(PointResult::accepted);
    logged_faults_ = fault_count_.load();
    logged_activity_.clear();
}

void ActivityReport::log(const rclcpp::Logger& logger, const ControlLaw& law)
{
    log_refusal(logger, law);
    log_faults(logger);
    log_activity(logger);
}

void ActivityReport::log_faults(const rclcpp::Logger& logger)
{
    const unsigned count = fault_count_.load();
    if (count == logged_faults_) {
        return;
    }
    const Fault fault = last_fault_.load();
    const bool has_reason = fault == Fault::rejected && *reason_.load() != '\0';
    RCLCPP_ERROR(logger, "efforts go to zero: %s (faults since the last report: %u)",
        has_reason ? reason_.load() : to_string(fault), count - logged_faults_);
    logged_faults_ = count;
    logged_activity_ = to_string(Activity::fault);
}

void ActivityReport::log_activity(const rclcpp::Logger& logger)
{
    const Activity activity = activity_.load();
    const std::string name = to_string(activity);
    if (activity == Activity::none || activity == Activity::fault || name == logged_activity_) {
        return;
    }
    logged_activity_ = name;
    const bool lacks_reference = activity == Activity::no_reference_gravity
        || activity == Activity::no_reference_damp || activity == Activity::no_reference_zero;
    const std::string text = lacks_reference ? name + ": " + describe(no_reference_.load()) : "efforts of " + name;
    RCLCPP_INFO(logger, "%s", text.c_str());
}

void ActivityReport::log_refusal(const rclcpp::Logger& logger, const ControlLaw& law)
{
    const PointResult refusal = refusal_.exchange(PointResult::accepted);
    if (refusal == PointResult::accepted) {
        return;
    }
    const std::size_t joint = refused_joint_.load();
    const bool has_joint = refusal == PointResult::not_finite || refusal == PointResult::beyond_limits;
    const std::string name = has_joint && joint < law.size() ? std::string(" (") + law.joint_name(joint) + ")" : "";
    RCLCPP_WARN(logger, "a reference is refused: %s%s", describe(refusal), name.c_str());
}

} // namespace robot_dynamics_control
