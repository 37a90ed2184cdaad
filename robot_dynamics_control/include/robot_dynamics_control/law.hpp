// The law as a controller uses it: a control law, a reference and a watchdog. Efforts never jump, and keep to limits.

#ifndef ROBOT_DYNAMICS_CONTROL_LAW_HPP
#define ROBOT_DYNAMICS_CONTROL_LAW_HPP

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"
#include "robot_dynamics_control/bumpless_transfer.hpp"
#include "robot_dynamics_control/control_law.hpp"
#include "robot_dynamics_control/model.hpp"
#include "robot_dynamics_control/modes.hpp"
#include "robot_dynamics_control/payload.hpp"
#include "robot_dynamics_control/reference_point.hpp"
#include "robot_dynamics_control/settings.hpp"
#include "robot_dynamics_control/watchdog.hpp"

namespace robot_dynamics_control {

/// Whether a point of a reference is used, or why not.
enum class PointResult {
    accepted,
    wrong_size,
    not_finite,
    too_old,
    beyond_limits, ///< of a position: Law::offending_joint says of which joint
    ahead ///< of the clock by more than reference_timeout
};

/// Why there is no reference.
enum class NoReference {
    none, ///< there is one
    none_yet,
    ended, ///< by `end_reference`
    timed_out, ///< no point came for reference_timeout
    dropped ///< efforts went to zero for longer than ramp_time
};

/// Computes efforts for states that come at times [s] of one clock, and decaying ones where states do not come.
///
/// Configure it, write each state into the buffers of `control_law()`, then call `step`, or `reject_state` where the
/// state cannot be used. Call `tick` where no state comes. Each returns the efforts to send, in a buffer that the next
/// call overwrites. Functions marked noexcept neither allocate nor lock. One thread at a time may use an object: what
/// other threads change goes through buffers of the caller.
///
/// Without a usable state the efforts decay to zero in ramp_time. With a state but without a reference they are those
/// of without_reference. After a fault longer than ramp_time the reference is dropped: the robot has moved in the
/// meantime, and the law does not decide where it should be then. A fault begins when the state becomes stale, also
/// where the program stalls and detects it later.
class Law {
public:
    /// Rounding [rad or m] by which a reference may exceed the limit of a joint.
    static constexpr double limit_tolerance = 1e-6;

    /// Use a model, joints by name (none: all with motors) and settings. Returns what is wrong, empty for success.
    std::string configure(const Model& model, const std::vector<std::string>& joints, const Settings& settings)
    {
        ControlLaw law;
        std::string error = law.configure(model, joints);
        if (!error.empty()) {
            return error;
        }
        Settings completed = complete(settings, law);
        error = find_objection(completed, law.size());
        if (!error.empty()) {
            return error;
        }
        law_ = std::move(law);
        settings_ = std::move(completed);
        const std::size_t size = law_.size();
        transfer_.resize(size);
        point_.resize(size);
        for (auto* values : {&desired_, &positions_, &velocities_, &accelerations_}) {
            values->assign(size, 0.0);
        }
        zeros_.assign(size, 0.0);
        use_settings();
        restart();
        return "";
    }

    /// Settings whose empty arrays are filled in, for `apply`: gains of zero, limits of the description.
    static Settings complete(Settings settings, const ControlLaw& law)
    {
        for (auto* gains : {&settings.kp, &settings.kd}) {
            if (gains->empty()) {
                gains->assign(law.size(), 0.0);
            }
        }
        if (settings.limits.empty()) {
            for (std::size_t i = 0; i < law.size(); ++i) {
                settings.limits.push_back(law.model().joint(law.joint_index(i)).effort);
            }
        }
        return settings;
    }

    /// Use other settings; the efforts change without a jump. Check them by `find_objection` before, outside the loop.
    ///
    /// Returns false, and changes nothing, where an array has not one number for each controlled joint, or a limit is
    /// negative or no number.
    bool apply(const Settings& settings) noexcept
    {
        for (const auto* values : {&settings.kp, &settings.kd, &settings.limits}) {
            if (values->size() != law_.size()) {
                return false;
            }
        }
        if (!std::all_of(settings.limits.begin(), settings.limits.end(), [](double limit) { return limit >= 0.0; })) {
            return false;
        }
        if (settings == settings_) {
            return true;
        }
        if (settings.mode != settings_.mode) {
            watchdog_.clear_latch();
        }
        settings_ = settings; // the arrays have the same size: nothing is allocated
        use_settings();
        start_transition();
        return true;
    }

    /// Carry another payload, an inertia (10) in Model::payload_frame; the efforts change without a jump.
    ///
    /// Returns false, and changes nothing, where the model has no payload, or `find_objection_to_payload` has a reason.
    bool set_payload(Numbers inertia) noexcept
    {
        if (!law_.model().is_bound() || !law_.model().has_payload() || *find_objection_to_payload(inertia) != '\0') {
            return false;
        }
        if (!std::equal(inertia.begin(), inertia.end(), law_.payload().begin())) {
            std::copy(inertia.begin(), inertia.end(), law_.payload().begin());
            start_transition();
        }
        return true;
    }

    /// Return to the initial condition: no states, no reference, no efforts. The payload remains.
    void restart() noexcept
    {
        watchdog_.clear_latch();
        watchdog_.restart();
        law_.forget_positions();
        transfer_.stop();
        no_reference_ = NoReference::none_yet;
        reference_time_.reset();
        regime_ = Activity::none;
        activity_ = Activity::none;
        fault_ = Fault::none;
    }

    /// Return to the initial condition, but with efforts that are in force, one for each controlled joint, or zero where
    /// they are not finite: the next efforts depart from them without a jump.
    void restart(Numbers efforts) noexcept
    {
        restart();
        transfer_.depart_from(efforts);
    }

    const Settings& settings() const noexcept { return settings_; }

    /// The control law, into whose buffers states are written.
    ControlLaw& control_law() noexcept { return law_; }
    const ControlLaw& control_law() const noexcept { return law_; }

    Watchdog& watchdog() noexcept { return watchdog_; }
    const Watchdog& watchdog() const noexcept { return watchdog_; }

    /// Number of controlled joints.
    std::size_t size() const noexcept { return law_.size(); }

    Numbers last_efforts() const noexcept { return transfer_.last_efforts(); }

    /// Whether the last effort of a controlled joint is at its limit.
    bool is_saturated(std::size_t index) const noexcept { return transfer_.is_saturated(index); }

    /// The reference at the last step that had one.
    Motion reference() const noexcept { return {positions_, velocities_, accelerations_}; }

    Activity activity() const noexcept { return activity_; }
    Fault fault() const noexcept { return fault_; }
    NoReference no_reference() const noexcept { return no_reference_; }
    std::size_t offending_joint() const noexcept { return offending_joint_; }

    /// The present fault as a text, empty without one; not for the control loop.
    std::string describe_fault() const
    {
        const bool has_reason = fault_ == Fault::rejected || fault_ == Fault::stale;
        if (has_reason && *watchdog_.rejection() != '\0') {
            const std::string reason = watchdog_.rejection();
            return fault_ == Fault::rejected ? reason : std::string(to_string(fault_)) + "; " + reason;
        }
        return to_string(fault_);
    }

    /// Track a point of a reference, of a time [s], from now on. Where it is refused the reference before it remains.
    PointResult track_point(double now, double time, const Motion& point) noexcept
    {
        for (const Numbers values : {point.positions, point.velocities, point.accelerations}) {
            if (values.size() != size()) {
                return PointResult::wrong_size;
            }
            offending_joint_ = find_not_finite(values);
            if (offending_joint_ < size()) {
                return PointResult::not_finite;
            }
        }
        if (!std::isfinite(now) || !std::isfinite(time)) {
            offending_joint_ = size();
            return PointResult::not_finite;
        }
        if (now - time > settings_.reference_timeout) {
            return PointResult::too_old;
        }
        if (time - now > settings_.reference_timeout) {
            return PointResult::ahead;
        }
        for (std::size_t i = 0; i < size(); ++i) {
            const robot_dynamics_joint& joint = law_.model().joint(law_.joint_index(i));
            if (point.positions[i] < joint.lower - limit_tolerance
                || point.positions[i] > joint.upper + limit_tolerance) {
                offending_joint_ = i;
                return PointResult::beyond_limits;
            }
        }
        point_.set(time, std::min(time, now) + settings_.reference_timeout, point);
        reference_time_ = now;
        no_reference_ = NoReference::none;
        watchdog_.clear_latch();
        return PointResult::accepted;
    }

    /// End the reference: the efforts are those of without_reference.
    void end_reference() noexcept { no_reference_ = NoReference::ended; }

    /// Let the next efforts depart from the last ones without a jump, whatever they follow then.
    void start_transition() noexcept { regime_ = Activity::none; }

    /// Efforts for the state in the buffers of the control law.
    Numbers step(double now) noexcept { return step(now, now, now); }

    /// Efforts for the state in the buffers of the control law.
    ///
    /// now: the present time [s]. time: when the state was measured; the reference is sampled there. published: when it
    /// left its sender; the watchdog takes it as the time of the state. A state that was measured more than
    /// state_timeout ago, or is ahead of the clock by more than that, is rejected.
    Numbers step(double now, double time, double published) noexcept
    {
        if (!law_.model().is_bound()) {
            return halt("the law has no model: it was not configured");
        }
        const ControlLaw& law = law_;
        const char* objection = find_objection_to_state(law);
        if (*objection != '\0') {
            return reject_state(now, objection);
        }
        if (!std::isfinite(time) || !std::isfinite(published)) {
            return reject_state(now, "a time of the state is not finite");
        }
        if (std::max(time, published) - now > settings_.state_timeout) {
            return reject_state(now, "the state is ahead of the clock by more than state_timeout");
        }
        if (now - time > settings_.state_timeout) {
            return reject_state(now, "the state was measured more than state_timeout ago");
        }
        watchdog_.check_clock(now);
        watchdog_.accept_state(published);
        return compute_efforts(now, time);
    }

    /// Efforts that decay to zero, for a state that cannot be used; the reason lives as long as the program.
    Numbers reject_state(double now, const char* reason) noexcept
    {
        if (!std::isfinite(now)) {
            return halt(time_is_not_finite);
        }
        watchdog_.check_clock(now);
        watchdog_.reject_state(reason);
        return compute_efforts(now, now);
    }

    /// Efforts that decay to zero, in the place of efforts that could not be sent in time.
    Numbers handle_overdue_efforts(double now) noexcept
    {
        if (!std::isfinite(now)) {
            return halt(time_is_not_finite);
        }
        watchdog_.check_clock(now);
        if (watchdog_.fault(now) == Fault::none) {
            watchdog_.reject_state("efforts were ready later than state_timeout after their state");
        }
        return compute_efforts(now, now);
    }

    /// Zero efforts at once, and until a good state comes: for a clock that stands still, or a sender that is too slow.
    Numbers halt(const char* reason) noexcept
    {
        watchdog_.reject_state(reason);
        fault_ = Fault::rejected;
        enter_regime(Activity::fault, std::nullopt);
        transfer_.stop();
        return last_efforts();
    }

    /// Efforts that decay to zero during a fault; where there is none, an empty view: `last_efforts` remain in force.
    Numbers tick(double now) noexcept
    {
        if (!std::isfinite(now)) {
            return halt(time_is_not_finite);
        }
        watchdog_.check_clock(now);
        fault_ = watchdog_.fault(now);
        return fault_ == Fault::none ? Numbers() : decay_to_zero(now);
    }

private:
    static constexpr const char* time_is_not_finite = "the time of the clock is not finite";

    void use_settings() noexcept
    {
        watchdog_.set(settings_.state_timeout, settings_.deadline, settings_.deadline_misses);
        transfer_.set(settings_.ramp_time, settings_.limits);
    }

    static const char* find_objection_to_state(const ControlLaw& law) noexcept
    {
        double sum = 0.0;
        for (const Numbers values : {law.q(), law.qd()}) {
            for (const double value : values) {
                sum += value * value;
            }
        }
        if (std::isfinite(sum)) {
            return "";
        }
        if (!all_finite(law.q())) {
            return "a position of the state is not finite";
        }
        return all_finite(law.qd()) ? "positions and velocities are too large"
                                    : "a velocity of the state is not finite";
    }

    /// Efforts at a time for the state of another time.
    Numbers compute_efforts(double now, double time) noexcept
    {
        fault_ = watchdog_.fault(now);
        if (fault_ != Fault::none) {
            return decay_to_zero(now);
        }
        const Activity activity = choose_activity(time);
        if (follows_reference(activity)
            && !law_.sample_reference(point_, time, positions_, velocities_, accelerations_)) {
            return fail(now, "the springs behind the motors are too soft for the bodies between both");
        }
        if (!apply_law(activity)) {
            return fail(now, "the loops of the robot do not close in this state, or are singular");
        }
        if (!all_finite(desired_)) {
            return fail(now, "the model gives efforts that are not finite in this state");
        }
        enter_regime(activity, std::nullopt);
        return transfer_.update(now, desired_);
    }

    Numbers fail(double now, const char* reason) noexcept
    {
        watchdog_.reject_state(reason);
        fault_ = watchdog_.fault(now);
        return decay_to_zero(now);
    }

    Numbers decay_to_zero(double now) noexcept
    {
        double since = *watchdog_.faulted_since(); // there is a fault
        enter_regime(Activity::fault, since);
        if (reference_time_ && since < *reference_time_ && *reference_time_ <= now) {
            since = *reference_time_; // the reference came during the fault
        }
        if (no_reference_ == NoReference::none && now - since > settings_.ramp_time) {
            no_reference_ = NoReference::dropped;
        }
        return transfer_.update(now, zeros_);
    }

    /// Start a transition where the efforts follow something else than before.
    void enter_regime(Activity activity, std::optional<double> since) noexcept
    {
        if (activity != regime_) {
            transfer_.start_transition(since);
            regime_ = activity;
            activity_ = activity;
        }
    }

    /// Whether efforts that follow something follow the reference.
    static bool follows_reference(Activity activity) noexcept
    {
        return activity == Activity::feedforward || activity == Activity::pd_gravity
            || activity == Activity::computed_torque;
    }

    /// What the efforts follow at a time of the state.
    Activity choose_activity(double time) noexcept
    {
        if (settings_.mode == Mode::gravity_compensation) {
            return Activity::gravity_compensation;
        }
        if (no_reference_ == NoReference::none && time > point_.end()) {
            no_reference_ = NoReference::timed_out;
        }
        if (no_reference_ != NoReference::none) {
            switch (settings_.without_reference) {
            case NoReferenceAction::gravity: return Activity::no_reference_gravity;
            case NoReferenceAction::damp: return Activity::no_reference_damp;
            case NoReferenceAction::zero: return Activity::no_reference_zero;
            }
        }
        switch (settings_.mode) {
        case Mode::feedforward: return Activity::feedforward;
        case Mode::pd_gravity: return Activity::pd_gravity;
        default: return Activity::computed_torque;
        }
    }

    /// Compute the desired efforts; false where the loops do not close.
    bool apply_law(Activity activity) noexcept
    {
        switch (activity) {
        case Activity::gravity_compensation:
        case Activity::no_reference_gravity: return law_.gravity_compensation(desired_);
        case Activity::no_reference_damp: return law_.damping(settings_.kd, desired_);
        case Activity::feedforward: return law_.feedforward(reference(), desired_);
        case Activity::pd_gravity: return law_.pd_gravity(reference(), settings_.kp, settings_.kd, desired_);
        case Activity::computed_torque:
            return law_.computed_torque(
                reference(), settings_.kp, settings_.kd, desired_, settings_.friction_velocity);
        default: std::fill(desired_.begin(), desired_.end(), 0.0); return true;
        }
    }

    ControlLaw law_;
    Settings settings_;
    Watchdog watchdog_;
    BumplessTransfer transfer_;
    ReferencePoint point_;
    std::vector<double> desired_;
    std::vector<double> zeros_;
    std::vector<double> positions_;
    std::vector<double> velocities_;
    std::vector<double> accelerations_;
    std::optional<double> reference_time_; // at which the reference came
    NoReference no_reference_ = NoReference::none_yet;
    Activity regime_ = Activity::none; // what the efforts follow, without a transition
    Activity activity_ = Activity::none;
    Fault fault_ = Fault::none;
    std::size_t offending_joint_ = 0;
};

} // namespace robot_dynamics_control

#endif
