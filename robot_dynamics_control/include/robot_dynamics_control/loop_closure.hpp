// Positions of all joints from those of the joints of the state, with the loops of the robot closed.

#ifndef ROBOT_DYNAMICS_CONTROL_LOOP_CLOSURE_HPP
#define ROBOT_DYNAMICS_CONTROL_LOOP_CLOSURE_HPP

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"
#include "robot_dynamics_control/model_abi.h"

namespace robot_dynamics_control {

/// Closes the loops of a robot from call to call by Newton's method, so that it stays in its assembly mode.
///
/// The first call, without measured positions of the joints that depend on others, follows a straight path from the
/// reference positions of the model. It takes as long as some hundred steps; later calls take two or three. Where the
/// joints of the state have moved far since the last call, the path is followed from there, because Newton's method may end
/// in another assembly mode.
class LoopClosure {
public:
    /// Residual [characteristic lengths, rad] at which a loop is closed.
    static constexpr double closure_tolerance = 1e-11;
    /// Residual below which rounding prevents a further decrease.
    static constexpr double newton_tolerance = 1e-13;
    /// Least quality of positions at which the loops determine the dependent joints.
    static constexpr double min_quality = 10 * closure_tolerance;
    /// Longest step [rad or characteristic lengths]: the linearization does not hold further away.
    static constexpr double max_step = 0.5;
    /// Strides of the path from the reference positions: the second one is tried where the first one fails.
    static constexpr double strides[] = {0.05, 0.01};
    static constexpr std::size_t max_strides = 700;
    /// Longest distance of the joints of the state [rad or characteristic lengths] on which no path is followed.
    static constexpr double longest_distance = 0.05;
    /// Part of a stride by which its end may deviate from the continuation of the last one, and a further deviation: a
    /// larger one means that the path bends, or has reached another branch.
    static constexpr double max_relative_deviation = 0.4;
    static constexpr double max_absolute_deviation = 1e-3;
    static constexpr int max_iterations = 40;
    static constexpr int max_halvings = 6;
    /// Ratio of the residuals after and before a step above which the iteration ends.
    static constexpr double sufficient_decrease = 0.999;
    /// Cosine of the pitch of a platform below which yaw and roll are nearly the same rotation.
    static constexpr double steep_pitch_cosine = 0.5;

    /// Allocate for a model; without loops there is nothing to do.
    void configure(const robot_dynamics_model& model)
    {
        loops_ = model.loops;
        joints_ = model.joints;
        joint_count_ = model.joint_count;
        position_count_ = model.position_count;
        if (loops_ == nullptr) {
            return;
        }
        const std::size_t variables = loops_->variable_count;
        const std::size_t dependents = loops_->dependent_count;
        for (auto* values : {&variables_, &start_, &trial_, &before_, &predicted_, &increment_}) {
            values->assign(variables, 0.0);
        }
        for (auto* values : {&step_, &trial_step_, &pivots_, &squared_norms_}) {
            values->assign(dependents, 0.0);
        }
        residual_.assign(loops_->row_count, 0.0);
        matrix_.assign(dependents * dependents, 0.0);
        target_.assign(joint_count_, 0.0);
    }

    /// A seed (position_count) that knows nothing.
    static void forget(MutableNumbers seed) noexcept
    {
        std::fill(seed.begin(), seed.end(), std::numeric_limits<double>::quiet_NaN());
    }

    /// Enter measured positions of the dependent joints into a seed; those that are not finite are unknown. The joints of
    /// the state are then where they are measured too, not where they were.
    void enter_dependent(Numbers dependent, MutableNumbers seed) noexcept
    {
        bool is_measured = false;
        for (std::size_t position = 0; position < position_count_; ++position) {
            const robot_dynamics_position& row = loops_->positions[position];
            for (std::size_t k = 0; k < loops_->dependent_count; ++k) {
                if (row.variable == loops_->dependent[k] && std::isfinite(dependent[k])) {
                    seed[position] = row.multiplier * dependent[k] + row.offset;
                    is_measured = true;
                }
            }
        }
        for (std::size_t position = 0; is_measured && position < position_count_; ++position) {
            if (is_of_state(position)) {
                seed[position] = std::numeric_limits<double>::quiet_NaN();
            }
        }
    }

    /// Positions of all joints for those of the joints of the state.
    ///
    /// q: joint_count numbers. positions: position_count numbers, those of the last call or `forget`; the closed ones
    /// are written. Returns false where the loops do not close or are singular; positions are then as before.
    bool close(Numbers q, MutableNumbers positions) noexcept
    {
        const bool has_seed = read_seed(positions);
        if (!(has_seed ? close_near(q, positions) : close_from_reference(q))) {
            return false;
        }
        for (std::size_t position = 0; position < position_count_; ++position) {
            const robot_dynamics_position& row = loops_->positions[position];
            positions[position] = row.multiplier * variables_[row.variable] + row.offset;
        }
        return true;
    }

private:
    /// Read variables from positions; false where no dependent one is known. Unknown ones are at the reference.
    bool read_seed(Numbers positions) noexcept
    {
        std::copy(loops_->reference, loops_->reference + loops_->variable_count, variables_.begin());
        for (std::size_t position = 0; position < position_count_; ++position) {
            const robot_dynamics_position& row = loops_->positions[position];
            if (std::isfinite(positions[position]) && row.multiplier != 0.0) {
                variables_[row.variable] = (positions[position] - row.offset) / row.multiplier;
            }
        }
        for (std::size_t k = 0; k < loops_->dependent_count; ++k) {
            for (std::size_t position = 0; position < position_count_; ++position) {
                const bool is_its_position = loops_->positions[position].variable == loops_->dependent[k];
                if (is_its_position && std::isfinite(positions[position])) {
                    return true;
                }
            }
        }
        return false;
    }

    void set_independent(Numbers q) noexcept
    {
        for (std::size_t k = 0; k < joint_count_; ++k) {
            variables_[loops_->independent[k]] = q[k];
        }
    }

    /// Whether a position is that of a joint of the state, or follows it.
    bool is_of_state(std::size_t position) const noexcept
    {
        const std::uint32_t* end = loops_->independent + joint_count_;
        return std::find(loops_->independent, end, loops_->positions[position].variable) != end;
    }

    /// Close the loops near the variables, which are those of positions; far from them along a straight path.
    bool close_near(Numbers q, Numbers positions) noexcept
    {
        bool is_known = true;
        for (std::size_t position = 0; position < position_count_; ++position) {
            is_known = is_known && (std::isfinite(positions[position]) || !is_of_state(position));
        }
        start_ = variables_; // of the same size: nothing is allocated
        set_target(q);
        if (is_known && distance_to_target() > longest_distance) {
            evaluate(variables_, step_);
            return follow_path_to(q, determinant_is_positive());
        }
        set_independent(q);
        return iterate(max_iterations) && is_regular();
    }

    /// Close the loops in the assembly mode of the reference positions, along a straight path from there.
    bool close_from_reference(Numbers q) noexcept
    {
        std::copy(loops_->reference, loops_->reference + loops_->variable_count, start_.begin());
        set_target(q);
        return follow_path_to(q, true);
    }

    bool follow_path_to(Numbers q, bool is_positive) noexcept
    {
        for (const double stride : strides) {
            if (follow_path(stride, is_positive)) {
                set_independent(q); // whole turns change nothing
                return true;
            }
        }
        return false;
    }

    /// The end of the path from the start: without whole turns of joints that may turn, unless limits tell turns apart.
    void set_target(Numbers q) noexcept
    {
        constexpr double turn = 6.283185307179586;
        for (std::size_t k = 0; k < joint_count_; ++k) {
            const double start = start_[loops_->independent[k]];
            target_[k] = loops_->motion[k] == ROBOT_DYNAMICS_MOVES_NO_LOOP ? start : q[k];
            if (loops_->motion[k] == ROBOT_DYNAMICS_MOVES_LOOPS_PERIODICALLY) {
                const double lower = joints_[k].lower;
                const double upper = joints_[k].upper;
                const bool is_limited = std::isfinite(upper - lower) && lower <= start && start <= upper;
                if (!is_limited || q[k] < lower || q[k] > upper) {
                    target_[k] = q[k] - turn * std::nearbyint((q[k] - start) / turn);
                }
            }
        }
    }

    /// Length of the path from the start to the target [rad or characteristic lengths].
    double distance_to_target() const noexcept
    {
        double length = 0.0;
        for (std::size_t k = 0; k < joint_count_; ++k) {
            const std::size_t variable = loops_->independent[k];
            length = std::max(length, std::abs(target_[k] - start_[variable]) / loops_->units[variable]);
        }
        return length;
    }

    /// Follow the path from the start in strides; whether the loops close, are regular, and stay in the assembly mode, whose
    /// determinant is positive or not, all along.
    bool follow_path(double stride, bool is_positive) noexcept
    {
        variables_ = start_;
        const double length = distance_to_target();
        if (!(length <= stride * static_cast<double>(max_strides))) {
            return false;
        }
        const auto count = std::max<std::size_t>(1, static_cast<std::size_t>(std::ceil(length / stride)));
        std::copy(variables_.begin(), variables_.end(), before_.begin());
        for (std::size_t number = 1; number <= count; ++number) {
            continue_stride(static_cast<double>(number) / static_cast<double>(count));
            if (!iterate(max_iterations) || !is_regular() || determinant_is_positive() != is_positive) {
                return false;
            }
            if (number > 1 && deviates()) { // the first stride continues none
                return false;
            }
        }
        return true;
    }

    /// Continue as in the last stride, with the joints of the state at a part of the path.
    void continue_stride(double part) noexcept
    {
        for (std::size_t k = 0; k < variables_.size(); ++k) {
            const double present = variables_[k];
            variables_[k] += present - before_[k];
            before_[k] = present;
        }
        for (std::size_t k = 0; k < joint_count_; ++k) {
            const double start = start_[loops_->independent[k]];
            variables_[loops_->independent[k]] = start + part * (target_[k] - start);
        }
        std::copy(variables_.begin(), variables_.end(), predicted_.begin());
    }

    bool deviates() const noexcept
    {
        double length = 0.0;
        double deviation = 0.0;
        for (std::size_t k = 0; k < variables_.size(); ++k) {
            length = std::max(length, std::abs(predicted_[k] - before_[k]) / loops_->units[k]);
            deviation = std::max(deviation, std::abs(variables_[k] - predicted_[k]) / loops_->units[k]);
        }
        return deviation > max_relative_deviation * length + max_absolute_deviation;
    }

    /// Newton's method with steps of limited length that decrease the residual; whether the loops are closed.
    bool iterate(int iterations) noexcept
    {
        evaluate(variables_, step_);
        double norm = squared_norm();
        for (int iteration = 0; iteration < iterations && !(largest_residual() <= newton_tolerance); ++iteration) {
            if (!set_increment() || !take_step(norm)) {
                evaluate(variables_, step_); // the last evaluation was that of a trial
                break;
            }
        }
        return largest_residual() <= closure_tolerance;
    }

    /// Take the step or a part of it that decreases the residual of squared norm `norm`.
    bool take_step(double& norm) noexcept
    {
        double fraction = 1.0;
        for (int halving = 0; halving < max_halvings; ++halving) {
            for (std::size_t k = 0; k < variables_.size(); ++k) {
                trial_[k] = variables_[k] + fraction * increment_[k];
            }
            evaluate(trial_, trial_step_);
            if (squared_norm() < sufficient_decrease * sufficient_decrease * norm) {
                norm = squared_norm();
                std::swap(variables_, trial_);
                std::swap(step_, trial_step_);
                return true;
            }
            fraction /= 2;
        }
        return false;
    }

    void evaluate(const std::vector<double>& variables, std::vector<double>& step) noexcept
    {
        loops_->step(variables.data(), residual_.data(), step.data(), pivots_.data(), squared_norms_.data(),
            matrix_.data());
    }

    double squared_norm() const noexcept
    {
        double sum = 0.0;
        for (const double value : residual_) {
            sum += value * value;
        }
        return sum;
    }

    /// Infinite where an entry is not finite.
    double largest_residual() const noexcept
    {
        double largest = 0.0;
        for (const double value : residual_) {
            largest = std::isfinite(value) ? std::max(largest, std::abs(value))
                                           : std::numeric_limits<double>::infinity();
        }
        return largest;
    }

    /// Set the displacement of the variables for a step; false where the pitch of a platform is steep.
    bool set_increment() noexcept
    {
        double excess = 1.0;
        for (std::size_t k = 0; k < step_.size(); ++k) {
            const double step = std::isfinite(step_[k]) ? step_[k] : 0.0;
            increment_[loops_->dependent[k]] = step;
            excess = std::max(excess, std::abs(step) / (max_step * loops_->units[loops_->dependent[k]]));
        }
        for (const std::uint32_t variable : ArrayView<const std::uint32_t>(loops_->dependent, step_.size())) {
            increment_[variable] /= excess;
        }
        for (std::size_t k = 0; k < loops_->attitude_count; ++k) {
            const std::uint32_t* columns = loops_->attitudes[k]; // yaw, pitch, roll
            const double cosine = std::cos(variables_[columns[1]]);
            if (!(std::abs(cosine) >= steep_pitch_cosine)) {
                return false;
            }
            increment_[columns[0]] /= cosine;
            increment_[columns[2]] += std::sin(variables_[columns[1]]) * increment_[columns[0]];
        }
        return true;
    }

    /// Whether the closed loops determine the dependent joints.
    bool is_regular() const noexcept
    {
        for (std::size_t k = 0; k < pivots_.size(); ++k) {
            if (!(pivots_[k] / squared_norms_[k] > min_quality)) {
                return false;
            }
        }
        return true;
    }

    /// Whether the determinant of the matrix is positive, by elimination with row pivots.
    bool determinant_is_positive() noexcept
    {
        const std::size_t size = loops_->dependent_count;
        bool is_positive = true;
        for (std::size_t k = 0; k < size; ++k) {
            std::size_t pivot = k;
            for (std::size_t row = k + 1; row < size; ++row) {
                if (std::abs(matrix_[row * size + k]) > std::abs(matrix_[pivot * size + k])) {
                    pivot = row;
                }
            }
            if (pivot != k) {
                std::swap_ranges(matrix_.begin() + static_cast<std::ptrdiff_t>(k * size),
                    matrix_.begin() + static_cast<std::ptrdiff_t>((k + 1) * size),
                    matrix_.begin() + static_cast<std::ptrdiff_t>(pivot * size));
                is_positive = !is_positive;
            }
            const double diagonal = matrix_[k * size + k];
            if (!(std::abs(diagonal) > 0.0)) {
                return false;
            }
            is_positive = is_positive != (diagonal < 0.0);
            for (std::size_t row = k + 1; row < size; ++row) {
                const double factor = matrix_[row * size + k] / diagonal;
                for (std::size_t column = k + 1; column < size; ++column) {
                    matrix_[row * size + column] -= factor * matrix_[k * size + column];
                }
            }
        }
        return is_positive;
    }

    const robot_dynamics_loops* loops_ = nullptr;
    const robot_dynamics_joint* joints_ = nullptr;
    std::size_t joint_count_ = 0;
    std::size_t position_count_ = 0;
    std::vector<double> variables_;
    std::vector<double> trial_;
    std::vector<double> before_;
    std::vector<double> predicted_;
    std::vector<double> increment_;
    std::vector<double> target_;
    std::vector<double> start_;
    std::vector<double> residual_;
    std::vector<double> step_;
    std::vector<double> trial_step_;
    std::vector<double> pivots_;
    std::vector<double> squared_norms_;
    std::vector<double> matrix_;
};

} // namespace robot_dynamics_control

#endif
