// Bumpless transfer: efforts without jumps when what they follow changes.

#ifndef ROBOT_DYNAMICS_CONTROL_BUMPLESS_TRANSFER_HPP
#define ROBOT_DYNAMICS_CONTROL_BUMPLESS_TRANSFER_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"

namespace robot_dynamics_control {

/// Passes efforts on, within limits; after `start_transition` their jump decays along a straight line.
///
/// Each jump decays along a line of its own, so that a transition that starts during another one does not prolong it.
/// Efforts thus depend on the desired ones even where transitions start all the time.
class BumplessTransfer {
public:
    /// Jumps that decay at the same time; those in an eighth of the duration are one.
    static constexpr std::size_t ramp_count = 8;
    /// Part of a limit by which an effort that continues at the limit may exceed it.
    static constexpr double rounding = 1e-12;

    /// Allocate for `size` efforts, all zero.
    void resize(std::size_t size)
    {
        efforts_.assign(size, 0.0);
        remainder_.assign(size, 0.0);
        limits_.assign(size, 0.0);
        saturated_.assign(size, 0);
        for (Ramp& ramp : ramps_) {
            ramp.jump.assign(size, 0.0);
        }
        end_transitions();
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

    /// Start a transition at the next update, or at a time [s]: the efforts may jump then, and are those desired at the
    /// end of the duration, whatever transitions there were before.
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
        end_transitions();
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
            start(now, desired);
        }
        if (is_in_transition_) {
            decay(now);
        }
        for (std::size_t i = 0; i < efforts_.size(); ++i) {
            const double effort = desired[i] + remainder_[i];
            saturated_[i] = std::abs(effort) > limits_[i] * (1.0 + rounding);
            efforts_[i] = std::clamp(effort, -limits_[i], limits_[i]);
        }
        return efforts_;
    }

private:
    struct Ramp {
        std::optional<double> start; // [s]
        std::vector<double> jump;
    };

    void start(double now, Numbers desired) noexcept
    {
        if (requested_start_) {
            end_transitions();
        }
        const double part = remaining_part(ramps_[newest_], now);
        const bool is_new = !(part > 1.0 - 1.0 / static_cast<double>(ramp_count));
        if (is_new) {
            newest_ = (newest_ + 1) % ramp_count;
            ramps_[newest_].start = requested_start_ ? *requested_start_ : now;
        }
        for (std::size_t i = 0; i < efforts_.size(); ++i) {
            const double jump = efforts_[i] - desired[i] - remainder_[i];
            double& sum = ramps_[newest_].jump[i];
            sum = is_new ? jump : sum + jump / part;
        }
        is_in_transition_ = true;
    }

    /// Compute what is left of all jumps.
    void decay(double now) noexcept
    {
        std::fill(remainder_.begin(), remainder_.end(), 0.0);
        bool is_over = true;
        for (const Ramp& ramp : ramps_) {
            const double part = remaining_part(ramp, now);
            if (part > 0.0) {
                is_over = false;
                for (std::size_t i = 0; i < remainder_.size(); ++i) {
                    remainder_[i] += part * ramp.jump[i];
                }
            }
        }
        if (is_over) {
            end_transitions();
        }
    }

    /// The part of a jump that is left at a time.
    double remaining_part(const Ramp& ramp, double now) const noexcept
    {
        if (!ramp.start || !(duration_ > 0.0)) {
            return 0.0;
        }
        const double part = 1.0 - (now - *ramp.start) / duration_;
        // clocks step back a little between two callers; a start far in the future belongs to another clock
        return 0.0 < part && part <= 2.0 ? std::min(part, 1.0) : 0.0;
    }

    void end_transitions() noexcept
    {
        for (Ramp& ramp : ramps_) {
            ramp.start.reset();
        }
        std::fill(remainder_.begin(), remainder_.end(), 0.0);
        is_in_transition_ = false;
    }

    double duration_ = 0.0;
    std::vector<double> efforts_;
    std::vector<double> limits_;
    std::vector<unsigned char> saturated_;
    std::array<Ramp, ramp_count> ramps_;
    std::size_t newest_ = 0;
    std::vector<double> remainder_; // of all jumps, at the last update
    bool is_in_transition_ = false;
    std::optional<double> requested_start_;
    bool is_requested_ = false;
};

} // namespace robot_dynamics_control

#endif
