// Transit times of messages between two machines whose clocks need not agree.

#ifndef ROBOT_DYNAMICS_CONTROL_TRANSIT_TIMES_HPP
#define ROBOT_DYNAMICS_CONTROL_TRANSIT_TIMES_HPP

#include <algorithm>
#include <cstdint>
#include <limits>

namespace robot_dynamics_control {

/// Delays of the messages of one publisher, relative to its fastest recent message.
///
/// The time of reception minus that of publication is the delay plus the offset between the two clocks, which is the
/// same for all messages. So delays count from the least difference among the last `window` to 2 `window` messages.
class TransitTimes {
public:
    /// Number of messages after which the least difference of the clocks is renewed.
    static constexpr int window = 1000;

    /// Forget all messages.
    void restart() noexcept { *this = TransitTimes(); }

    /// Delay [s] of a message, received and published at times [ns] by the clocks of both sides.
    ///
    /// It is 0 where the time of publication is unknown, which a time of 0 means.
    double delay(std::int64_t received, std::int64_t published) noexcept
    {
        if (published == 0) {
            return 0.0;
        }
        const std::int64_t difference = received - published;
        if (count_ == window) {
            count_ = 0;
            previous_least_ = least_;
            least_ = unknown;
        }
        ++count_;
        least_ = std::min(least_, difference);
        return static_cast<double>(difference - std::min(least_, previous_least_)) * 1e-9;
    }

private:
    static constexpr std::int64_t unknown = std::numeric_limits<std::int64_t>::max();

    int count_ = 0;
    std::int64_t least_ = unknown;
    std::int64_t previous_least_ = unknown;
};

} // namespace robot_dynamics_control

#endif
