// Bumpless transfer: efforts without jumps when what they follow changes.

#ifndef ROBOT_DYNAMICS_CONTROL_BUMPLESS_TRANSFER_HPP
#define ROBOT_DYNAMICS_CONTROL_BUMPLESS_TRANSFER_HPP

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"

namespace robot_dynamics_control {

/// Passes efforts on, within limits; after `start_transition` their jump decays along a straight line.
class BumplessTransfer {
public:
    /// Allocate for `size` efforts, all zero.
    void resize(std::size_t size)
    {
        efforts_.assign(size, 0.0);
        jump_.assign(size, 0.0);
        limits_.assign(size, 0.0);
        saturated_.assign(size, 0);
        transition_start_.reset();
        is_requested_ = false;
    }

    /// Duration of a transition [s], and maximum magnitude of each effort [N m or N].
    void set(double duration, Numbers limits) noexcept
    {
        duration_ = duration;
        std::copy(limits.begin(), limits.end(), limits_.begin());
    }

    Numbers last_efforts() const noexcept { return efforts_; }

    /// Whether the last effort of a joint is at its limit.
    bool is_saturated(std::size_t index) const noexcept { return saturated_[index] != 0; }

    /// Start a transition at a time [s]; without one at the next update, whose efforts may jump.
    void start_transition(std::optional<double> since) noexcept
    {
        is_requested_ = true;
        requested_start_ = since;
    }

    /// Set all efforts to zero. The next update has no transition unless `start_transition` is called.
    void stop() noexcept
    {
        std::fill(efforts_.begin(), efforts_.end(), 0.0);
        std::fill(saturated_.begin(), saturated_.end(), static_cast<unsigned char>(0));
        transition_start_.reset();
        is_requested_ = false;
    }

    /// Set the last efforts, within limits and zero where they are not finite.
    void depart_from(Numbers efforts) noexcept
    {
        for (std::size_t i = 0; i < efforts_.size() && i < efforts.size(); ++i) {
            efforts_[i] = std::isfinite(efforts[i]) ? std::clamp(efforts[i], -limits_[i], limits_[i]) : 0.0;
        }
    }

    /// Efforts at a time [s] for the desired ones.
    Numbers update(double now, Numbers desired) noexcept
    {
        if (is_requested_) {
            is_requested_ = false;
            transition_start_ = requested_start_ ? *requested_start_ : now;
            for (std::size_t i = 0; i < efforts_.size(); ++i) {
                jump_[i] = efforts_[i] - desired[i];
            }
        }
        const double remaining = remaining_part(now);
        for (std::size_t i = 0; i < efforts_.size(); ++i) {
            const double effort = desired[i] + remaining * jump_[i];
            saturated_[i] = std::abs(effort) > limits_[i];
            efforts_[i] = std::clamp(effort, -limits_[i], limits_[i]);
        }
        return efforts_;
    }

private:
    /// The part of the jump that is left; a transition that is over ends.
    double remaining_part(double now) noexcept
    {
        if (!transition_start_) {
            return 0.0;
        }
        const double remaining = duration_ > 0.0 ? 1.0 - (now - *transition_start_) / duration_ : 0.0;
        if (0.0 < remaining && remaining <= 1.0) {
            return remaining;
        }
        transition_start_.reset();
        return 0.0;
    }

    double duration_ = 0.0;
    std::vector<double> efforts_;
    std::vector<double> jump_;
    std::vector<double> limits_;
    std::vector<unsigned char> saturated_;
    std::optional<double> transition_start_;
    std::optional<double> requested_start_;
    bool is_requested_ = false;
};

} // namespace robot_dynamics_control

#endif
