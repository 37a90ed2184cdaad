// The watchdog of the states: a state machine of times and reasons.

#ifndef ROBOT_DYNAMICS_CONTROL_WATCHDOG_HPP
#define ROBOT_DYNAMICS_CONTROL_WATCHDOG_HPP

#include <algorithm>
#include <optional>

namespace robot_dynamics_control {

/// Why no efforts may be sent.
enum class Fault {
    none,
    rejected, ///< the last state cannot be used: Watchdog::rejection says why
    stale, ///< there is no state younger than the timeout
    stalled, ///< the program did not call for longer than the timeout, or its clock jumped ahead
    clock_jumped_back, ///< latched: until a new reference, another mode or a restart
    late, ///< too many efforts in a row were late
    blocked ///< the caller set it, and ends it
};

/// A short text for a fault.
inline const char* to_string(Fault fault) noexcept
{
    switch (fault) {
    case Fault::none: return "";
    case Fault::rejected: return "the state cannot be used";
    case Fault::stale: return "no state for longer than state_timeout";
    case Fault::stalled: return "the program stalled, or its clock jumped ahead";
    case Fault::clock_jumped_back:
        return "the clock jumped back; a new reference, another mode or a new activation clears this fault";
    case Fault::late: return "efforts are late";
    case Fault::blocked: return "efforts are blocked";
    }
    return "";
}

/// Decides whether efforts may be sent, and gives the reason where they may not. Times are seconds of one clock.
///
/// A fault lasts until a good state comes; a latched one until `clear_latch`. Call `check_clock` first whenever
/// something comes, and more often than every timeout. Reasons are texts that live as long as the program.
class Watchdog {
public:
    /// timeout: age at which a state is stale; deadline: latency from a state to its efforts that is late;
    /// max_misses: number of late efforts in a row that are a fault.
    void set(double timeout, double deadline, int max_misses) noexcept
    {
        timeout_ = timeout;
        deadline_ = deadline;
        max_misses_ = max_misses;
    }

    /// Forget all states. A latched fault, and one that is blocked, last.
    void restart() noexcept
    {
        last_state_.reset();
        now_.reset();
        rejection_ = "no state yet";
        rejected_at_.reset();
        has_stalled_ = false;
        misses_ = 0;
        faulted_since_.reset();
    }

    /// Time of the last good state.
    std::optional<double> last_state_time() const noexcept { return last_state_; }

    /// Why the last state cannot be used; empty where it can.
    const char* rejection() const noexcept { return rejection_; }

    /// Time at which the present fault began. It is before now where the state became stale between two calls.
    std::optional<double> faulted_since() const noexcept { return faulted_since_; }

    /// How often the program stalled.
    unsigned long stall_count() const noexcept { return stall_count_; }

    /// End a latched fault.
    void clear_latch() noexcept { is_latched_ = false; }

    /// Set a fault that neither a good state nor `clear_latch` ends, only false.
    void block(bool is_blocked) noexcept { is_blocked_ = is_blocked; }

    /// Record a good state that was published at a time.
    void accept_state(double published) noexcept
    {
        last_state_ = published;
        rejection_ = "";
    }

    /// Record a state that cannot be used, at the time of `check_clock`.
    void reject_state(const char* reason) noexcept
    {
        rejection_ = reason;
        rejected_at_ = now_;
    }

    /// Record the time [s] from a state to its efforts.
    void record_latency(double latency) noexcept
    {
        const bool is_in_time = latency <= deadline_; // nan is not
        misses_ = is_in_time ? 0 : std::min(misses_ + 1, max_misses_);
    }

    /// Detect that the clock jumped back, or that the program stalled, at a time.
    ///
    /// A stall is a fault because the last efforts were in force all the while. It ends with the next call.
    void check_clock(double now) noexcept
    {
        const std::optional<double> previous = now_;
        now_ = now;
        has_stalled_ = false;
        if (!previous) {
            return;
        }
        if (now < *previous - timeout_) {
            is_latched_ = true;
            last_state_.reset();
            rejection_ = "no state since the clock jumped back";
            rejected_at_.reset();
            faulted_since_.reset();
        } else if (now - *previous > timeout_) {
            ++stall_count_;
            if (!faulted_since_) { // otherwise there is a reason already
                has_stalled_ = true;
                faulted_since_ = stale_since(now);
            }
        }
    }

    /// The reason why no efforts may be sent at a time.
    Fault fault(double now) noexcept
    {
        const Fault reason = find_fault(now);
        if (reason == Fault::none) {
            faulted_since_.reset();
        } else if (!faulted_since_) {
            faulted_since_ = stale_since(now);
        }
        return reason;
    }

private:
    /// Time at which the last state became stale, at most now.
    double stale_since(double now) const noexcept
    {
        return last_state_ ? std::min(now, *last_state_ + timeout_) : now;
    }

    Fault find_fault(double now) const noexcept
    {
        if (is_blocked_) {
            return Fault::blocked;
        }
        if (is_latched_) {
            return Fault::clock_jumped_back;
        }
        if (has_stalled_) {
            return Fault::stalled;
        }
        if (*rejection_ != '\0') {
            return rejected_at_ && now - *rejected_at_ > timeout_ ? Fault::stale : Fault::rejected;
        }
        if (last_state_ && now - *last_state_ > timeout_) {
            return Fault::stale;
        }
        return misses_ >= max_misses_ ? Fault::late : Fault::none;
    }

    double timeout_ = 0.02;
    double deadline_ = 0.005;
    int max_misses_ = 10;
    std::optional<double> last_state_;
    std::optional<double> now_;
    std::optional<double> rejected_at_; // of a state; without a value where there was none
    std::optional<double> faulted_since_;
    const char* rejection_ = "no state yet";
    unsigned long stall_count_ = 0;
    int misses_ = 0;
    bool has_stalled_ = false;
    bool is_latched_ = false;
    bool is_blocked_ = false;
};

} // namespace robot_dynamics_control

#endif
