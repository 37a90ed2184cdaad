// The control laws: efforts from the state of a robot and a reference, by its inverse model.

#ifndef ROBOT_DYNAMICS_CONTROL_CONTROL_LAW_HPP
#define ROBOT_DYNAMICS_CONTROL_CONTROL_LAW_HPP

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"
#include "robot_dynamics_control/deflection_solver.hpp"
#include "robot_dynamics_control/loop_closure.hpp"
#include "robot_dynamics_control/model.hpp"
#include "robot_dynamics_control/modes.hpp"
#include "robot_dynamics_control/reference_point.hpp"

namespace robot_dynamics_control {

/// The control laws of one robot. ID is the inverse model without friction, f the friction, e = q_d - q, and gains are
/// those of the error, [1/s²] and [1/s], the same for heavy and light joints:
///
///     gravity_compensation  ID(q, 0, 0)
///     damping               ID(q, 0, -K_d q̇)
///     pd_gravity            ID(q, 0, K_p e + K_d ė)
///     feedforward           ID(q_d, q̇_d, q̈_d) + f(q̇_d)
///     computed_torque       ID(q, q̇, q̈_d + K_p e + K_d ė) + f(q̇_f)
///
/// q̇_f is the velocity of the reference, or the measured one. Friction that depends on the load of a joint has the
/// effort ID of that joint as its load. Joints that are not controlled do not accelerate; unactuated ones move freely.
///
/// Where a motor drives its link through a spring, references are those of the link, and q_d is the position of the
/// motor that `sample_reference` finds. Springs then accelerate in ID as in the reference. Their positions and
/// velocities need not be measured: where nobody writes into their buffers, they are those of the reference.
///
/// After `configure` nothing allocates, locks or throws. One thread at a time may use an object. The laws write the
/// efforts of the controlled joints, and return false where the loops of the robot do not close.
class ControlLaw {
public:
    /// Use a model, and control joints by their names, in this order; without names all joints with motors.
    ///
    /// Returns what is wrong, empty where the laws can be used.
    std::string configure(const Model& model, const std::vector<std::string>& joints = {})
    {
        if (!model.is_bound()) {
            return "there is no model: bind it first";
        }
        std::vector<std::size_t> indices;
        std::string error = find_joints(model, joints, indices);
        if (!error.empty()) {
            return error;
        }
        model_ = model;
        indices_ = std::move(indices);
        allocate();
        return "";
    }

    const Model& model() const noexcept { return model_; }

    /// Number of controlled joints, k.
    std::size_t size() const noexcept { return indices_.size(); }

    /// Index of a controlled joint among those of the state.
    std::size_t joint_index(std::size_t controlled) const noexcept { return indices_[controlled]; }

    const char* joint_name(std::size_t controlled) const noexcept { return model_.joint(indices_[controlled]).name; }

    /// Positions and velocities of all joints of the state, buffers to write into.
    MutableNumbers q() noexcept { return q_; }
    MutableNumbers qd() noexcept { return qd_; }
    Numbers q() const noexcept { return q_; }
    Numbers qd() const noexcept { return qd_; }

    /// Measured positions of the joints that loops determine, a buffer to write into; nan where they are unknown.
    MutableNumbers dependent_positions() noexcept { return dependent_; }

    /// Twist (6) of a moving base and gravity (3), both in the base frame, buffers to write into.
    MutableNumbers twist() noexcept { return twist_; }
    MutableNumbers gravity() noexcept { return gravity_; }

    /// Inertia (10) of the payload in Model::payload_frame, a buffer to write into; zero without a payload.
    MutableNumbers payload() noexcept { return payload_; }

    /// Errors e and ė (k) of the last call with a reference.
    Numbers error() const noexcept { return error_; }
    Numbers rate_error() const noexcept { return rate_error_; }

    /// Whether a joint of the state is a spring behind a motor, which need not be measured.
    bool is_spring(std::size_t joint) const noexcept { return deflections_.is_spring(joint); }

    /// Sample a reference of the links at a time [s] as one of the controlled joints.
    ///
    /// Returns false where springs are too soft for the bodies between them and their motors.
    bool sample_reference(const ReferencePoint& source, double time, MutableNumbers positions,
        MutableNumbers velocities, MutableNumbers accelerations) noexcept
    {
        if (!deflections_.has_springs()) {
            source.sample(time, positions, velocities, accelerations);
            return true;
        }
        const auto evaluate = [this](const std::vector<double>& q, const std::vector<double>& qd,
                                  const std::vector<double>& qdd, std::vector<double>& efforts) {
            model_.inverse(
                q.data(), qd.data(), qdd.data(), twist_.data(), gravity_.data(), payload_.data(), efforts.data());
        };
        return deflections_.compute_motor_reference(
            source, time, q_, qd_, evaluate, positions, velocities, accelerations);
    }

    /// Forget the past: the next state is closed from the reference positions of the loops, and dampers remember nothing.
    void forget_positions() noexcept
    {
        deflections_.forget();
        LoopClosure::forget(measured_);
        LoopClosure::forget(desired_);
    }

    /// Close the loops at the state in the buffers: call it before the loop, since the first closure takes longest.
    bool close_loops() noexcept { return measured_positions() != nullptr; }

    bool gravity_compensation(MutableNumbers out) noexcept
    {
        set_accelerations([](std::size_t) { return 0.0; });
        return inverse(measured_positions(), rest_, out);
    }

    bool damping(Numbers kd, MutableNumbers out) noexcept
    {
        set_accelerations([&](std::size_t i) { return -kd[i] * qd_[indices_[i]]; });
        return inverse(measured_positions(), rest_, out);
    }

    bool pd_gravity(const Motion& reference, Numbers kp, Numbers kd, MutableNumbers out) noexcept
    {
        compute_errors(reference);
        set_accelerations([&](std::size_t i) { return kp[i] * error_[i] + kd[i] * rate_error_[i]; });
        return inverse(measured_positions(), rest_, out);
    }

    bool feedforward(const Motion& reference, MutableNumbers out) noexcept
    {
        compute_errors(reference);
        set_reference_velocities(reference);
        std::copy(q_.begin(), q_.end(), reference_q_.begin());
        for (std::size_t i = 0; i < size(); ++i) {
            reference_q_[indices_[i]] = reference.positions[i];
        }
        for (std::size_t spring = 0; spring < deflections_.size(); ++spring) {
            reference_q_[deflections_.joint(spring)] = deflections_.positions()[spring];
        }
        set_accelerations([&](std::size_t i) { return reference.accelerations[i]; }, true);
        const double* positions = reference_positions();
        if (!inverse(positions, reference_velocities_, out)) {
            return false;
        }
        add_friction(positions, reference_velocities_, out);
        return true;
    }

    bool computed_torque(const Motion& reference, Numbers kp, Numbers kd, MutableNumbers out,
        FrictionVelocity friction_velocity = FrictionVelocity::reference) noexcept
    {
        compute_errors(reference);
        set_reference_velocities(reference);
        set_accelerations(
            [&](std::size_t i) { return reference.accelerations[i] + kp[i] * error_[i] + kd[i] * rate_error_[i]; },
            true);
        const bool has_springs = deflections_.has_springs();
        if (has_springs) {
            complete_state_with_springs();
        }
        const std::vector<double>& velocities = has_springs ? completed_qd_ : qd_;
        const double* positions = has_springs ? completed_q_.data() : measured_positions();
        if (!inverse(positions, velocities, out)) {
            return false;
        }
        const bool is_measured = friction_velocity == FrictionVelocity::measured;
        add_friction(positions, is_measured ? velocities : reference_velocities_, out);
        return true;
    }

private:
    static std::string find_joints(
        const Model& model, const std::vector<std::string>& names, std::vector<std::size_t>& indices)
    {
        for (std::size_t index = 0; names.empty() && index < model.joint_count(); ++index) {
            if (model.joint(index).actuated != 0) {
                indices.push_back(index);
            }
        }
        for (const std::string& name : names) {
            const std::size_t index = model.find_joint(name);
            if (index == model.joint_count()) {
                return "joint '" + name + "' is no independent joint of '" + model.robot()
                    + "', whose independent joints are " + joint_names(model);
            }
            if (model.joint(index).actuated == 0) {
                return "joint '" + name + "' has no motor: leave it out";
            }
            if (std::find(indices.begin(), indices.end(), index) != indices.end()) {
                return "joint '" + name + "' is named more than once";
            }
            indices.push_back(index);
        }
        const robot_dynamics_springs* springs = model.table().springs;
        for (std::size_t number = 0; springs != nullptr && number < springs->count; ++number) {
            const robot_dynamics_spring& spring = springs->springs[number];
            if (std::find(indices.begin(), indices.end(), spring.motor) == indices.end()) {
                return std::string("joint '") + model.joint(spring.motor).name + "' drives its link through the spring '"
                    + model.joint(spring.joint).name + "': add it to the joints that get efforts";
            }
        }
        return indices.empty() ? "'" + model.robot() + "' has no actuated joint: there is nothing to control" : "";
    }

    static std::string joint_names(const Model& model)
    {
        std::string names;
        for (std::size_t index = 0; index < model.joint_count(); ++index) {
            names += std::string(index == 0 ? "" : ", ") + model.joint(index).name;
        }
        return names;
    }

    void allocate()
    {
        const std::size_t joints = model_.joint_count();
        for (auto* values : {&q_, &qd_, &rest_, &reference_q_, &reference_velocities_, &accelerations_, &efforts_,
                 &completed_q_, &completed_qd_}) {
            values->assign(joints, 0.0);
        }
        deflections_.configure(model_, indices_);
        for (std::size_t spring = 0; spring < deflections_.size(); ++spring) {
            q_[deflections_.joint(spring)] = deflections_.unmeasured_position(spring);
        }
        for (auto* values : {&error_, &rate_error_}) {
            values->assign(size(), 0.0);
        }
        dependent_.assign(model_.dependent_count(), std::numeric_limits<double>::quiet_NaN());
        measured_.assign(model_.position_count(), 0.0);
        desired_.assign(model_.position_count(), 0.0);
        twist_.assign(6, 0.0);
        gravity_.assign(model_.table().gravity, model_.table().gravity + 3);
        payload_.assign(ROBOT_DYNAMICS_INERTIA_SIZE, 0.0);
        closure_.configure(model_.table());
        forget_positions();
        has_load_friction_ = false;
        turns_endlessly_.assign(size(), 0);
        for (std::size_t i = 0; i < size(); ++i) {
            const robot_dynamics_joint& joint = model_.joint(indices_[i]);
            has_load_friction_ = has_load_friction_ || joint.load_friction != 0.0;
            turns_endlessly_[i] = joint.prismatic == 0 && std::isinf(joint.lower) && std::isinf(joint.upper);
        }
    }

    /// Errors of the state, without whole turns of joints that turn endlessly.
    void compute_errors(const Motion& reference) noexcept
    {
        constexpr double turn = 6.283185307179586;
        for (std::size_t i = 0; i < size(); ++i) {
            error_[i] = reference.positions[i] - q_[indices_[i]];
            rate_error_[i] = reference.velocities[i] - qd_[indices_[i]];
            if (turns_endlessly_[i] != 0) {
                error_[i] -= turn * std::nearbyint(error_[i] / turn);
            }
        }
    }

    /// Set the accelerations of the controlled joints, and of springs, which may accelerate as in the reference.
    template <typename Function>
    void set_accelerations(Function acceleration, bool springs_accelerate = false) noexcept
    {
        for (std::size_t i = 0; i < size(); ++i) {
            accelerations_[indices_[i]] = acceleration(i);
        }
        for (std::size_t spring = 0; spring < deflections_.size(); ++spring) {
            accelerations_[deflections_.joint(spring)]
                = springs_accelerate ? deflections_.accelerations()[spring] : 0.0;
        }
    }

    /// The state with springs that are not measured as in the reference.
    void complete_state_with_springs() noexcept
    {
        completed_q_ = q_;
        completed_qd_ = qd_;
        for (std::size_t spring = 0; spring < deflections_.size(); ++spring) {
            const std::size_t joint = deflections_.joint(spring);
            if (q_[joint] == deflections_.unmeasured_position(spring)) {
                completed_q_[joint] = deflections_.positions()[spring];
                completed_qd_[joint] = deflections_.velocities()[spring];
            }
        }
    }

    void set_reference_velocities(const Motion& reference) noexcept
    {
        for (std::size_t i = 0; i < size(); ++i) {
            reference_velocities_[indices_[i]] = reference.velocities[i];
        }
        for (std::size_t spring = 0; spring < deflections_.size(); ++spring) {
            reference_velocities_[deflections_.joint(spring)] = deflections_.velocities()[spring];
        }
    }

    /// Positions that the models take, at the measured state; null where the loops do not close.
    const double* measured_positions() noexcept
    {
        if (!model_.has_loops()) {
            return q_.data();
        }
        closure_.enter_dependent(dependent_, measured_);
        return closure_.close(q_, measured_) ? measured_.data() : nullptr;
    }

    const double* reference_positions() noexcept
    {
        if (!model_.has_loops()) {
            return reference_q_.data();
        }
        return closure_.close(reference_q_, desired_) ? desired_.data() : nullptr;
    }

    /// Write the efforts for `accelerations_`; false where there are no positions.
    bool inverse(const double* positions, const std::vector<double>& velocities, MutableNumbers out) noexcept
    {
        if (positions == nullptr) {
            return false;
        }
        model_.inverse(positions, velocities.data(), accelerations_.data(), twist_.data(), gravity_.data(),
            payload_.data(), efforts_.data());
        for (std::size_t i = 0; i < size(); ++i) {
            out[i] = efforts_[indices_[i]];
        }
        return true;
    }

    /// Add friction to the efforts without friction, which are the loads.
    void add_friction(const double* positions, const std::vector<double>& velocities, MutableNumbers out) noexcept
    {
        for (std::size_t i = 0; has_load_friction_ && i < size(); ++i) {
            const double velocity = velocities[indices_[i]];
            const double direction = velocity > 0.0 ? 1.0 : (velocity < 0.0 ? -1.0 : velocity);
            out[i] += model_.joint(indices_[i]).load_friction * std::abs(out[i]) * direction;
        }
        if (model_.has_friction()) {
            model_.friction(positions, velocities.data(), efforts_.data());
            for (std::size_t i = 0; i < size(); ++i) {
                out[i] += efforts_[indices_[i]];
            }
        }
    }

    Model model_;
    LoopClosure closure_;
    DeflectionSolver deflections_;
    std::vector<std::size_t> indices_;
    std::vector<double> q_;
    std::vector<double> qd_;
    std::vector<double> dependent_;
    std::vector<double> measured_;
    std::vector<double> desired_;
    std::vector<double> twist_;
    std::vector<double> gravity_;
    std::vector<double> payload_;
    std::vector<double> rest_;
    std::vector<double> reference_q_;
    std::vector<double> reference_velocities_;
    std::vector<double> completed_q_;
    std::vector<double> completed_qd_;
    std::vector<double> accelerations_;
    std::vector<double> efforts_;
    std::vector<double> error_;
    std::vector<double> rate_error_;
    std::vector<unsigned char> turns_endlessly_;
    bool has_load_friction_ = false;
};

} // namespace robot_dynamics_control

#endif
