// One point of a stream of references.

#ifndef ROBOT_DYNAMICS_CONTROL_REFERENCE_POINT_HPP
#define ROBOT_DYNAMICS_CONTROL_REFERENCE_POINT_HPP

#include <algorithm>
#include <cstddef>
#include <vector>

#include "robot_dynamics_control/array_view.hpp"

namespace robot_dynamics_control {

/// Positions, velocities and accelerations of the controlled joints.
struct Motion {
    Numbers positions;
    Numbers velocities;
    Numbers accelerations;
};

/// One point of a stream. Until the next one the joints continue with its velocity and acceleration.
class ReferencePoint {
public:
    /// Allocate for `size` joints.
    void resize(std::size_t size)
    {
        for (auto* values : {&positions_, &velocities_, &accelerations_}) {
            values->assign(size, 0.0);
        }
    }

    /// Use a point of a time [s], valid until another time.
    void set(double time, double end, const Motion& point) noexcept
    {
        time_ = time;
        end_ = end;
        std::copy(point.positions.begin(), point.positions.end(), positions_.begin());
        std::copy(point.velocities.begin(), point.velocities.end(), velocities_.begin());
        std::copy(point.accelerations.begin(), point.accelerations.end(), accelerations_.begin());
    }

    /// Time of the point [s].
    double start() const noexcept { return time_; }

    /// Time until which the point is valid [s].
    double end() const noexcept { return end_; }

    /// Write the reference at a time [s].
    void sample(
        double time, MutableNumbers positions, MutableNumbers velocities, MutableNumbers accelerations) const noexcept
    {
        const double s = std::max(time - time_, 0.0);
        for (std::size_t i = 0; i < positions_.size(); ++i) {
            positions[i] = positions_[i] + s * velocities_[i] + (0.5 * s * s) * accelerations_[i];
            velocities[i] = velocities_[i] + s * accelerations_[i];
            accelerations[i] = accelerations_[i];
        }
    }

private:
    double time_ = 0.0;
    double end_ = 0.0;
    std::vector<double> positions_;
    std::vector<double> velocities_;
    std::vector<double> accelerations_;
};

} // namespace robot_dynamics_control

#endif
