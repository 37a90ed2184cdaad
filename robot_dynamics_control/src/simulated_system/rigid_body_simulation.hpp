// The motion of a robot without loops under efforts, by its inverse model.

#ifndef ROBOT_DYNAMICS_CONTROL_RIGID_BODY_SIMULATION_HPP
#define ROBOT_DYNAMICS_CONTROL_RIGID_BODY_SIMULATION_HPP

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"
#include "robot_dynamics_control/model.hpp"

namespace robot_dynamics_control {

/// Integrates the accelerations A⁻¹(τ - b) by the Runge-Kutta method of fourth order. Column j of the mass matrix A is
/// ID(q, 0, e_j) - ID(q, 0, 0), and b is ID(q, q̇, 0) and friction (Walker and Orin, 1982). There are no joint stops.
class RigidBodySimulation {
public:
    /// Use a model. Returns what is wrong, empty where it can be simulated.
    std::string configure(const Model& model)
    {
        if (model.has_loops() || model.has_moving_base()) {
            return "'" + model.robot() + "' has loops or a moving base: this simulation is for trees on a fixed base";
        }
        if (model.has_springs()) {
            return "motors of '" + model.robot() + "' drive their links through springs: this simulation has none";
        }
        model_ = model;
        const std::size_t n = model.joint_count();
        for (auto* values : {&q_, &qd_, &rest_, &bias_, &middle_q_, &middle_qd_, &column_, &acceleration_}) {
            values->assign(n, 0.0);
        }
        for (auto& slope : slopes_) {
            slope.assign(2 * n, 0.0);
        }
        matrix_.assign(n * n, 0.0);
        return "";
    }

    MutableNumbers q() noexcept { return q_; }
    MutableNumbers qd() noexcept { return qd_; }

    /// Inertia (10) of the payload, a buffer to write into.
    MutableNumbers payload() noexcept { return payload_; }

    /// Move for a time [s] under constant efforts; false where an inertia is not positive.
    bool step(double duration, Numbers efforts) noexcept
    {
        constexpr std::array<double, 4> nodes{0.0, 0.5, 0.5, 1.0};
        const std::size_t n = q_.size();
        for (std::size_t stage = 0; stage < nodes.size(); ++stage) {
            const double h = nodes[stage] * duration;
            const std::vector<double>& before = slopes_[stage == 0 ? 0 : stage - 1];
            for (std::size_t i = 0; i < n; ++i) {
                middle_q_[i] = q_[i] + (stage == 0 ? 0.0 : h * before[i]);
                middle_qd_[i] = qd_[i] + (stage == 0 ? 0.0 : h * before[n + i]);
            }
            if (!compute_accelerations(efforts)) {
                return false;
            }
            for (std::size_t i = 0; i < n; ++i) {
                slopes_[stage][i] = middle_qd_[i];
                slopes_[stage][n + i] = acceleration_[i];
            }
        }
        for (std::size_t i = 0; i < n; ++i) {
            q_[i] += duration / 6.0 * weighted_slope(i);
            qd_[i] += duration / 6.0 * weighted_slope(n + i);
        }
        return true;
    }

private:
    double weighted_slope(std::size_t i) const noexcept
    {
        return slopes_[0][i] + 2.0 * slopes_[1][i] + 2.0 * slopes_[2][i] + slopes_[3][i];
    }

    void inverse(const std::vector<double>& velocities, const std::vector<double>& accelerations,
        std::vector<double>& out) const noexcept
    {
        model_.inverse(middle_q_.data(), velocities.data(), accelerations.data(), nullptr, model_.table().gravity,
            payload_.data(), out.data());
    }

    /// Accelerations at the state in the middle.
    bool compute_accelerations(Numbers efforts) noexcept
    {
        const std::size_t n = q_.size();
        inverse(rest_, rest_, bias_);
        for (std::size_t j = 0; j < n; ++j) {
            acceleration_.assign(n, 0.0);
            acceleration_[j] = 1.0;
            inverse(rest_, acceleration_, column_);
            for (std::size_t i = 0; i < n; ++i) {
                matrix_[i * n + j] = column_[i] - bias_[i];
            }
        }
        inverse(middle_qd_, rest_, bias_);
        std::vector<double>& right = acceleration_;
        for (std::size_t i = 0; i < n; ++i) {
            right[i] = efforts[i] - bias_[i];
        }
        if (model_.has_friction()) {
            model_.friction(middle_q_.data(), middle_qd_.data(), column_.data());
            for (std::size_t i = 0; i < n; ++i) {
                right[i] -= column_[i];
            }
        }
        return solve();
    }

    /// Solve A x = b in place of b by Cholesky's decomposition; false where A is not positive definite.
    bool solve() noexcept
    {
        const std::size_t n = q_.size();
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = j; i < n; ++i) {
                double sum = matrix_[i * n + j];
                for (std::size_t k = 0; k < j; ++k) {
                    sum -= matrix_[i * n + k] * matrix_[j * n + k];
                }
                if (i == j && !(sum > 0.0)) {
                    return false;
                }
                matrix_[i * n + j] = i == j ? std::sqrt(sum) : sum / matrix_[j * n + j];
            }
        }
        for (std::size_t i = 0; i < n; ++i) {
            for (std::size_t k = 0; k < i; ++k) {
                acceleration_[i] -= matrix_[i * n + k] * acceleration_[k];
            }
            acceleration_[i] /= matrix_[i * n + i];
        }
        for (std::size_t i = n; i-- > 0;) {
            for (std::size_t k = i + 1; k < n; ++k) {
                acceleration_[i] -= matrix_[k * n + i] * acceleration_[k];
            }
            acceleration_[i] /= matrix_[i * n + i];
        }
        return true;
    }

    Model model_;
    std::vector<double> q_;
    std::vector<double> qd_;
    std::vector<double> rest_;
    std::vector<double> bias_;
    std::vector<double> middle_q_;
    std::vector<double> middle_qd_;
    std::vector<double> column_;
    std::vector<double> acceleration_;
    std::vector<double> matrix_;
    std::array<std::vector<double>, 4> slopes_;
    std::array<double, ROBOT_DYNAMICS_INERTIA_SIZE> payload_{};
};

} // namespace robot_dynamics_control

#endif
