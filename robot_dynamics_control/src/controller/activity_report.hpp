// What the update loop does, for the log: written by the loop without a lock, read by another thread.

#ifndef ROBOT_DYNAMICS_CONTROL_ACTIVITY_REPORT_HPP
#define ROBOT_DYNAMICS_CONTROL_ACTIVITY_REPORT_HPP

#include <atomic>
#include <cstddef>
#include <string>

#include <rclcpp/logger.hpp>

#include "robot_dynamics_control/law.hpp"

namespace robot_dynamics_control {

/// Logs what changed since the last call of `log`.
class ActivityReport {
public:
    /// Record what the law does. For the update loop.
    void record(const Law& law) noexcept
    {
        if (law.fault() != Fault::none && law.fault() != fault_.load()) {
            reason_.store(law.watchdog().rejection());
            last_fault_.store(law.fault());
            fault_count_.fetch_add(1); // also of a fault that is over before `log` sees it
        }
        fault_.store(law.fault());
        no_reference_.store(law.no_reference());
        activity_.store(law.activity());
    }

    /// Record that a reference was refused. For the update loop.
    void record_refusal(PointResult result, std::size_t joint) noexcept
    {
        refused_joint_.store(joint);
        refusal_.store(result);
    }

    /// Forget all, before the law is used.
    void restart() noexcept;

    /// Log what changed. Not for the update loop.
    void log(const rclcpp::Logger& logger, const ControlLaw& law);

private:
    void log_refusal(const rclcpp::Logger& logger, const ControlLaw& law);
    void log_faults(const rclcpp::Logger& logger);
    void log_activity(const rclcpp::Logger& logger);

    std::atomic<Activity> activity_{Activity::none};
    std::atomic<Fault> fault_{Fault::none};
    std::atomic<Fault> last_fault_{Fault::none};
    std::atomic<unsigned> fault_count_{0};
    std::atomic<NoReference> no_reference_{NoReference::none_yet};
    std::atomic<const char*> reason_{""}; // lives as long as the program
    std::atomic<PointResult> refusal_{PointResult::accepted};
    std::atomic<std::size_t> refused_joint_{0};
    unsigned logged_faults_ = 0;
    std::string logged_activity_;
};

} // namespace robot_dynamics_control

#endif
