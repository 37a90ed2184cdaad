// Settings of the law, and what is wrong with them.

#ifndef ROBOT_DYNAMICS_CONTROL_SETTINGS_HPP
#define ROBOT_DYNAMICS_CONTROL_SETTINGS_HPP

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"
#include "robot_dynamics_control/modes.hpp"

namespace robot_dynamics_control {

/// Settings of the law of some joints. Arrays have one number for each controlled joint.
struct Settings {
    Mode mode = Mode::gravity_compensation;
    std::vector<double> kp; ///< gains of the position error [1/s²]; empty: zero
    std::vector<double> kd; ///< gains of the velocity error [1/s]; empty: zero
    std::vector<double> limits; ///< maximum magnitude of the efforts [N m or N]; empty: those of the description
    NoReferenceAction without_reference = NoReferenceAction::damp;
    double state_timeout = 0.02; ///< age at which a state is stale [s]
    double reference_timeout = 0.1; ///< duration for which a point of a reference is valid [s]
    double ramp_time = 0.1; ///< duration of transitions, and of the decay of the efforts to zero after a fault [s]
    double deadline = 0.005; ///< latency from a state to its efforts that is late [s]
    int deadline_misses = 10; ///< number of late efforts in a row that are a fault
    FrictionVelocity friction_velocity = FrictionVelocity::reference;
};

inline bool operator==(const Settings& a, const Settings& b)
{
    const auto members = [](const Settings& settings) {
        return std::tie(settings.mode, settings.kp, settings.kd, settings.limits, settings.without_reference,
            settings.state_timeout, settings.reference_timeout, settings.ramp_time, settings.deadline,
            settings.deadline_misses, settings.friction_velocity);
    };
    return members(a) == members(b);
}

/// What is wrong with settings of `size` joints whose arrays are complete; empty where nothing is.
inline std::string find_objection(const Settings& settings, std::size_t size)
{
    using NamedArray = std::pair<const char*, const std::vector<double>*>;
    for (const auto& [name, values] :
        {NamedArray{"kp", &settings.kp}, NamedArray{"kd", &settings.kd}, NamedArray{"limits", &settings.limits}}) {
        if (values->size() != size) {
            return std::string(name) + " has " + std::to_string(values->size()) + " numbers, "
                + std::to_string(size) + " are needed: one for each joint";
        }
        for (const double value : *values) {
            const bool may_be_infinite = values == &settings.limits;
            if (!(value >= 0.0) || (!may_be_infinite && !std::isfinite(value))) {
                return std::string(name) + " has " + std::to_string(value) + ": numbers from 0 on are needed";
            }
        }
    }
    if (std::all_of(settings.limits.begin(), settings.limits.end(), [](double limit) { return limit == 0.0; })) {
        return "all efforts are limited to 0, so that nothing but zeros could be sent: set the limits";
    }
    using NamedTime = std::pair<const char*, double>;
    for (const auto& [name, value] : {NamedTime{"state_timeout", settings.state_timeout},
             NamedTime{"reference_timeout", settings.reference_timeout}, NamedTime{"deadline", settings.deadline}}) {
        if (!(value > 0.0) || !std::isfinite(value)) {
            return std::string(name) + " is " + std::to_string(value) + ": a time above 0 s is needed";
        }
    }
    if (!(settings.ramp_time >= 0.0) || !std::isfinite(settings.ramp_time)) {
        return "ramp_time is " + std::to_string(settings.ramp_time) + ": a time from 0 s on is needed";
    }
    return settings.deadline_misses > 0 ? "" : "deadline_misses is not above 0";
}

} // namespace robot_dynamics_control

#endif
