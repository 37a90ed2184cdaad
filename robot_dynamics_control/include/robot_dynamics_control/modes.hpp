// Modes of control: what the efforts are made of, and what happens without a reference.

#ifndef ROBOT_DYNAMICS_CONTROL_MODES_HPP
#define ROBOT_DYNAMICS_CONTROL_MODES_HPP

#include <string_view>

namespace robot_dynamics_control {

/// The control laws; `ControlLaw` has their equations.
enum class Mode { gravity_compensation, feedforward, computed_torque, pd_gravity };

/// Efforts without a reference: gravity compensation, gravity compensation and damping, or zero.
enum class NoReferenceAction { gravity, damp, zero };

/// The velocity at which computed_torque compensates friction.
enum class FrictionVelocity { reference, measured };

/// What the efforts follow.
enum class Activity {
    none, ///< nothing yet
    gravity_compensation,
    feedforward,
    computed_torque,
    pd_gravity,
    no_reference_gravity,
    no_reference_damp,
    no_reference_zero,
    fault ///< they go to zero, or are zero
};

/// The name of a mode, as the parameters of computed_torque have it.
inline const char* to_string(Mode mode) noexcept
{
    switch (mode) {
    case Mode::gravity_compensation: return "gravity_compensation";
    case Mode::feedforward: return "feedforward";
    case Mode::computed_torque: return "computed_torque";
    case Mode::pd_gravity: return "pd_gravity";
    }
    return "";
}

/// The name of an action.
inline const char* to_string(NoReferenceAction action) noexcept
{
    switch (action) {
    case NoReferenceAction::gravity: return "gravity";
    case NoReferenceAction::damp: return "damp";
    case NoReferenceAction::zero: return "zero";
    }
    return "";
}

/// The name of a velocity.
inline const char* to_string(FrictionVelocity velocity) noexcept
{
    return velocity == FrictionVelocity::measured ? "measured" : "reference";
}

/// What the efforts follow, as the node computed_torque reports it.
inline const char* to_string(Activity activity) noexcept
{
    switch (activity) {
    case Activity::none: return "";
    case Activity::gravity_compensation: return "gravity_compensation";
    case Activity::feedforward: return "feedforward";
    case Activity::computed_torque: return "computed_torque";
    case Activity::pd_gravity: return "pd_gravity";
    case Activity::no_reference_gravity: return "no reference: gravity";
    case Activity::no_reference_damp: return "no reference: damp";
    case Activity::no_reference_zero: return "no reference: zero";
    case Activity::fault: return "fault";
    }
    return "";
}

/// Find the value of an enumeration by its name; false where no value has it.
template <typename Value, std::size_t N>
bool find_named(std::string_view name, const Value (&values)[N], Value& found) noexcept
{
    for (const Value value : values) {
        if (name == to_string(value)) {
            found = value;
            return true;
        }
    }
    return false;
}

/// Parse the name of a mode; false where there is none of that name.
inline bool parse(std::string_view name, Mode& mode) noexcept
{
    constexpr Mode values[] = {Mode::gravity_compensation, Mode::feedforward, Mode::computed_torque, Mode::pd_gravity};
    return find_named(name, values, mode);
}

/// Parse the name of an action; false where there is none of that name.
inline bool parse(std::string_view name, NoReferenceAction& action) noexcept
{
    constexpr NoReferenceAction values[] = {
        NoReferenceAction::gravity, NoReferenceAction::damp, NoReferenceAction::zero};
    return find_named(name, values, action);
}

/// Parse the name of a velocity; false where there is none of that name.
inline bool parse(std::string_view name, FrictionVelocity& velocity) noexcept
{
    constexpr FrictionVelocity values[] = {FrictionVelocity::reference, FrictionVelocity::measured};
    return find_named(name, values, velocity);
}

} // namespace robot_dynamics_control

#endif
