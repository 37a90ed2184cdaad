// Springs between motors and their links: the motion of the motors that gives the links a desired motion.

#ifndef ROBOT_DYNAMICS_CONTROL_DEFLECTION_SOLVER_HPP
#define ROBOT_DYNAMICS_CONTROL_DEFLECTION_SOLVER_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"
#include "robot_dynamics_control/model.hpp"
#include "robot_dynamics_control/reference_point.hpp"

namespace robot_dynamics_control {

/// Deflections δ = q_s - q_0 of springs while their links follow a reference y. The motors move as y - δ.
///
/// Spring and damper transmit the torque τ that the link needs: d δ̇ + k δ = τ. τ is minus the effort of the spring in
/// the inverse model, where springs are motors. It follows from the motion of the links and, where bodies between
/// motors and springs have inertia, from δ as well; then the solution is found by iteration.
///
/// The solution is the sum of two parts. Where τ is the polynomial p through its values at nodes around a time, one
/// part is the polynomial σ with d σ̇ + k σ = p. The other one, c exp(-k t / d), is the memory of the damper: it keeps δ
/// continuous where the reference is not smooth. Where d / k is less than the time between two nodes it is left out.
class DeflectionSolver {
public:
    static constexpr double node_spacing = 2e-3; ///< time between two nodes [s]
    static constexpr double solution_step = 3.0 * node_spacing; ///< time for which a polynomial is used [s]
    static constexpr double memory_time_constants = 30.0; ///< multiples of d / k after which a deflection is forgotten
    static constexpr int max_history_steps = 250; ///< steps through the past of a point
    static constexpr double negligible_deflection = 1e-12; ///< relative deflection that is neglected
    static constexpr int max_iterations = 10; ///< where τ depends on the deflections
    static constexpr double convergence_tolerance = 1e-8; ///< relative change at which the iteration ends
    static constexpr double divergence_threshold = 1e-2; ///< relative change from which there is no solution

    /// Use the springs of a model, whose motors are all among the controlled joints.
    void configure(const Model& model, const std::vector<std::size_t>& controlled)
    {
        springs_.clear();
        controlled_ = controlled;
        is_decoupled_ = true;
        longest_memory_ = 0.0;
        free_joints_.clear();
        if (const robot_dynamics_springs* table = model.table().springs) {
            is_decoupled_ = table->decoupled != 0;
            for (std::size_t number = 0; number < table->count; ++number) {
                springs_.push_back(make_spring(table->springs[number]));
                longest_memory_ = std::max(longest_memory_, springs_.back().memory);
            }
            for (std::size_t joint = 0; joint < model.joint_count(); ++joint) {
                if (model.joint(joint).actuated == 0 && !is_spring(joint)) {
                    free_joints_.push_back(joint);
                }
            }
        }
        const std::size_t joints = model.joint_count();
        for (auto* values : {&q_, &qd_, &qdd_, &efforts_}) {
            values->assign(joints, 0.0);
        }
        for (auto& motion : samples_) {
            motion.resize(controlled.size());
        }
        sampled_.resize(controlled.size());
        for (auto* rows : {&loads_, &coefficients_, &previous_}) {
            rows->fill(std::vector<double>(springs_.size(), 0.0));
        }
        for (auto& node : deflections_) {
            node.fill(std::vector<double>(springs_.size(), 0.0));
        }
        motion_.fill(std::vector<double>(springs_.size(), 0.0));
        last_.assign(springs_.size(), 0.0);
        forget();
    }

    bool has_springs() const noexcept { return !springs_.empty(); }

    /// Whether a joint of the state is a spring behind a motor.
    bool is_spring(std::size_t joint) const noexcept
    {
        return std::any_of(
            springs_.begin(), springs_.end(), [joint](const Spring& spring) { return spring.joint == joint; });
    }

    /// Number of springs.
    std::size_t size() const noexcept { return springs_.size(); }

    /// Index of a spring among the joints of the state.
    std::size_t joint(std::size_t spring) const noexcept { return springs_[spring].joint; }

    /// Position of a spring that is not measured: that of an unloaded spring, but for the last digit, so that no sensor
    /// gives it.
    double unmeasured_position(std::size_t spring) const noexcept { return springs_[spring].unmeasured; }

    /// Positions, velocities and accelerations of the springs at the time of the last reference.
    Numbers positions() const noexcept { return motion_[0]; }
    Numbers velocities() const noexcept { return motion_[1]; }
    Numbers accelerations() const noexcept { return motion_[2]; }

    /// Forget the deflections that dampers remember.
    void forget() noexcept { time_.reset(); }

    /// Write the motion of the controlled joints at a time [s] for a reference of the links.
    ///
    /// q, qd: the measured state. inverse(q, qd, qdd, efforts) evaluates the inverse model. Returns false where the
    /// springs are too soft for the bodies between them and the motors.
    template <typename Inverse>
    bool compute_motor_reference(const ReferencePoint& source, double time, Numbers q, Numbers qd, Inverse inverse,
        MutableNumbers positions, MutableNumbers velocities, MutableNumbers accelerations) noexcept
    {
        const auto solve_at = [&](double at) { return solve(source, at, q, qd, inverse); };
        if (!advance_to(source.start(), time, solve_at) || !solve_at(time)) {
            forget();
            return false;
        }
        const std::array<MutableNumbers, 3> out{positions, velocities, accelerations};
        remember(time);
        for (std::size_t order = 0; order < 3; ++order) {
            motion_[order] = deflections_[centre][order];
            std::copy(samples_[centre].orders[order].begin(), samples_[centre].orders[order].end(), out[order].begin());
            for (std::size_t spring = 0; spring < size(); ++spring) {
                out[order][springs_[spring].motor] -= motion_[order][spring];
            }
        }
        for (std::size_t spring = 0; spring < size(); ++spring) {
            motion_[0][spring] += springs_[spring].rest;
        }
        return true;
    }

private:
    static constexpr std::size_t nodes = 7;
    static constexpr std::size_t centre = nodes / 2;

    using Rows = std::array<std::vector<double>, nodes>; // of springs, at the nodes or of the powers

    struct Spring {
        std::size_t motor; // among the controlled joints
        std::size_t motor_joint; // among the joints of the state
        std::size_t joint;
        double stiffness;
        double rest;
        double unmeasured;
        double time_constant; // d / k
        double memory; // d / k, 0 where the damper has no memory
    };

    struct Sample {
        std::array<std::vector<double>, 3> orders; // positions, velocities, accelerations of the controlled joints

        void resize(std::size_t size) { orders.fill(std::vector<double>(size, 0.0)); }
    };

    static constexpr double node(std::size_t index) noexcept
    {
        return static_cast<double>(index) - static_cast<double>(centre);
    }

    Spring make_spring(const robot_dynamics_spring& row) const
    {
        Spring spring{};
        spring.motor_joint = row.motor;
        spring.motor = static_cast<std::size_t>(
            std::find(controlled_.begin(), controlled_.end(), row.motor) - controlled_.begin());
        spring.joint = row.joint;
        spring.stiffness = row.stiffness;
        spring.rest = row.rest;
        spring.unmeasured = std::nextafter(row.rest, HUGE_VAL);
        spring.time_constant = row.damping / row.stiffness;
        spring.memory = is_decoupled_ && spring.time_constant > node_spacing ? spring.time_constant : 0.0;
        return spring;
    }

    void remember(double time) noexcept
    {
        time_ = time;
        last_ = deflections_[centre][0];
    }

    /// Solve the equation until less than solution_step before a time, where dampers have a memory.
    template <typename Solve>
    bool advance_to(double start, double time, Solve solve_at) noexcept
    {
        const double reach = std::min(memory_time_constants * longest_memory_, max_history_steps * solution_step);
        if (reach == 0.0) {
            forget();
            return true;
        }
        if (!time_ || !(time - reach <= *time_ && *time_ <= time)) {
            const double begin = std::min(std::max(start, time - reach), time);
            forget();
            if (!solve_at(begin)) {
                return false;
            }
            time_ = begin;
            for (std::size_t spring = 0; spring < size(); ++spring) {
                last_[spring] = -loads_[centre][spring] / springs_[spring].stiffness;
            }
        }
        while (time - *time_ > solution_step) {
            const double now = *time_ + solution_step;
            if (!solve_at(now)) {
                return false;
            }
            remember(now);
        }
        return true;
    }

    /// Compute deflections and their derivatives at the nodes around a time from the previous deflections.
    template <typename Inverse>
    bool solve(const ReferencePoint& source, double time, Numbers q, Numbers qd, Inverse inverse) noexcept
    {
        sample_nodes(source, time);
        for (auto& node : deflections_) {
            for (auto& values : node) {
                std::fill(values.begin(), values.end(), 0.0);
            }
        }
        double change = 0.0;
        double largest = 0.0;
        for (int iteration = 0; iteration < (is_decoupled_ ? 1 : max_iterations); ++iteration) {
            for (std::size_t index = 0; index < nodes; ++index) {
                previous_[index] = deflections_[index][0];
                compute_loads(index, q, qd, inverse);
            }
            for (std::size_t spring = 0; spring < size(); ++spring) {
                find_polynomial(spring);
                evaluate_polynomial(spring);
                add_memory(spring, time);
            }
            change = largest = 0.0;
            for (std::size_t index = 0; index < nodes; ++index) {
                for (std::size_t spring = 0; spring < size(); ++spring) {
                    const double deflection = deflections_[index][0][spring];
                    change = std::max(change, std::abs(deflection - previous_[index][spring]));
                    largest = std::max(largest, std::abs(deflection));
                }
            }
            if (change <= convergence_tolerance * largest) {
                return true;
            }
        }
        return is_decoupled_ || change <= divergence_threshold * largest;
    }

    /// Samples of the reference at the nodes: earlier points are unknown, so that this one is extrapolated to both sides.
    void sample_nodes(const ReferencePoint& source, double time) noexcept
    {
        source.sample(time, sampled_.orders[0], sampled_.orders[1], sampled_.orders[2]);
        const auto& [positions, velocities, accelerations] = sampled_.orders;
        for (std::size_t index = 0; index < nodes; ++index) {
            const double t = node(index) * node_spacing;
            for (std::size_t i = 0; i < positions.size(); ++i) {
                samples_[index].orders[0][i] = positions[i] + t * velocities[i] + 0.5 * t * t * accelerations[i];
                samples_[index].orders[1][i] = velocities[i] + t * accelerations[i];
                samples_[index].orders[2][i] = accelerations[i];
            }
        }
    }

    /// Efforts of the springs, -τ, at a node: the links follow the sample, the motors stay behind by the deflections.
    /// Other joints stay at their positions, and those without motors keep their velocities.
    template <typename Inverse>
    void compute_loads(std::size_t index, Numbers q, Numbers qd, Inverse inverse) noexcept
    {
        std::copy(q.begin(), q.end(), q_.begin());
        std::fill(qd_.begin(), qd_.end(), 0.0);
        std::fill(qdd_.begin(), qdd_.end(), 0.0);
        for (const std::size_t joint : free_joints_) {
            qd_[joint] = qd[joint];
        }
        const std::array<std::vector<double>*, 3> state{&q_, &qd_, &qdd_};
        for (std::size_t order = 0; order < 3; ++order) {
            for (std::size_t i = 0; i < controlled_.size(); ++i) {
                (*state[order])[controlled_[i]] = samples_[index].orders[order][i];
            }
            for (std::size_t spring = 0; spring < size(); ++spring) {
                const double deflection = deflections_[index][order][spring];
                (*state[order])[springs_[spring].motor_joint] -= deflection;
                (*state[order])[springs_[spring].joint] = deflection + (order == 0 ? springs_[spring].rest : 0.0);
            }
        }
        inverse(q_, qd_, qdd_, efforts_);
        for (std::size_t spring = 0; spring < size(); ++spring) {
            loads_[index][spring] = efforts_[springs_[spring].joint];
        }
    }

    /// Coefficients of σ in powers of s = (t - time) / node_spacing.
    void find_polynomial(std::size_t spring) noexcept
    {
        // of the polynomials that are 1 at one node and 0 at the others, times 720: powers by nodes
        static constexpr double interpolation[nodes][nodes] = {
            {0, 0, 0, 720, 0, 0, 0},
            {-12, 108, -540, 0, 540, -108, 12},
            {4, -54, 540, -980, 540, -54, 4},
            {15, -120, 195, 0, -195, 120, -15},
            {-5, 60, -195, 280, -195, 60, -5},
            {-3, 12, -15, 0, 15, -12, 3},
            {1, -6, 15, -20, 15, -6, 1},
        };
        const double middle = loads_[centre][spring];
        const double ratio = springs_[spring].time_constant / node_spacing;
        double next = 0.0; // of d / k σ̇, by the next higher power
        for (std::size_t power = nodes; power-- > 0;) {
            double value = 0.0;
            for (std::size_t index = 0; index < nodes; ++index) {
                // differences from the centre make rates at rest exactly zero, because friction depends on their sign
                value += interpolation[power][index] * (middle - loads_[index][spring]);
            }
            value = value / 720.0 / springs_[spring].stiffness - next;
            next = ratio * static_cast<double>(power) * value;
            coefficients_[power][spring] = value;
        }
        coefficients_[0][spring] -= middle / springs_[spring].stiffness;
    }

    /// Write σ and its derivatives at the nodes.
    void evaluate_polynomial(std::size_t spring) noexcept
    {
        for (std::size_t index = 0; index < nodes; ++index) {
            const double s = node(index);
            std::array<double, 3> values{}; // of the derivatives over s, each divided by the factorial of its order
            for (std::size_t power = nodes; power-- > 0;) {
                values[2] = values[2] * s + values[1];
                values[1] = values[1] * s + values[0];
                values[0] = values[0] * s + coefficients_[power][spring];
            }
            deflections_[index][0][spring] = values[0];
            deflections_[index][1][spring] = values[1] / node_spacing;
            deflections_[index][2][spring] = 2.0 * values[2] / (node_spacing * node_spacing);
        }
    }

    /// Add what the damper remembers of the last deflection.
    void add_memory(std::size_t spring, double time) noexcept
    {
        const double time_constant = springs_[spring].memory;
        if (!time_ || time_constant == 0.0) {
            return;
        }
        const double elapsed = *time_ - time;
        double polynomial = 0.0;
        for (std::size_t power = nodes; power-- > 0;) {
            polynomial = polynomial * (elapsed / node_spacing) + coefficients_[power][spring];
        }
        const double remainder = (last_[spring] - polynomial) * std::exp(elapsed / time_constant);
        if (!(std::abs(remainder) > negligible_deflection * std::abs(coefficients_[0][spring]))) {
            return;
        }
        for (std::size_t index = 0; index < nodes; ++index) {
            double part = remainder * std::exp(-node(index) * node_spacing / time_constant);
            for (std::size_t order = 0; order < 3; ++order) {
                deflections_[index][order][spring] += part;
                part /= -time_constant;
            }
        }
    }

    std::vector<Spring> springs_;
    std::vector<std::size_t> controlled_;
    std::vector<std::size_t> free_joints_; // without motors, and no springs behind motors
    bool is_decoupled_ = true; // τ does not depend on the deflections
    double longest_memory_ = 0.0;
    std::optional<double> time_; // of the last deflections
    std::vector<double> last_;
    std::array<std::vector<double>, 3> motion_;
    std::array<Sample, nodes> samples_;
    Sample sampled_;
    std::array<std::array<std::vector<double>, 3>, nodes> deflections_;
    Rows loads_;
    Rows coefficients_;
    Rows previous_;
    std::vector<double> q_;
    std::vector<double> qd_;
    std::vector<double> qdd_;
    std::vector<double> efforts_;
};

} // namespace robot_dynamics_control

#endif
