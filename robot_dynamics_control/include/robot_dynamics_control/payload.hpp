// What is wrong with the inertia of a payload.

#ifndef ROBOT_DYNAMICS_CONTROL_PAYLOAD_HPP
#define ROBOT_DYNAMICS_CONTROL_PAYLOAD_HPP

#include <algorithm>
#include <array>
#include <cstddef>

#include "robot_dynamics_control/array_view.hpp"
#include "robot_dynamics_control/model_abi.h"

namespace robot_dynamics_control {

/// Share of the largest moment by which moments about the centre of mass may be below zero: rounding of the numbers.
constexpr double inertia_tolerance = 1e-5;

/// The inertia (10) of a point mass [kg] with first moments (3) [kg m]; of zero mass: all zero but the first moments.
inline std::array<double, ROBOT_DYNAMICS_INERTIA_SIZE> point_mass(double mass, const double* first_moments) noexcept
{
    const double x = first_moments[0];
    const double y = first_moments[1];
    const double z = first_moments[2];
    if (mass == 0.0) {
        return {mass, x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    }
    return {mass, x, y, z, (y * y + z * z) / mass, -x * y / mass, -x * z / mass, (x * x + z * z) / mass, -y * z / mass,
        (x * x + y * y) / mass};
}

/// What is wrong with an inertia (10) of a payload: a text that lives as long as the program, empty where nothing is.
///
/// With an inertia that no body has, the mass matrix of the robot can have a negative eigenvalue, and feedback by the
/// model then drives the robot away from its reference.
inline const char* find_objection_to_payload(Numbers inertia) noexcept
{
    if (inertia.size() != ROBOT_DYNAMICS_INERTIA_SIZE) {
        return "10 numbers are needed: mass, first moments, and xx xy xz yy yz zz of the second moments";
    }
    if (!all_finite(inertia)) {
        return "a number is not finite";
    }
    const double mass = inertia[0];
    if (mass < 0.0) {
        return "the mass is negative";
    }
    if (mass == 0.0) {
        const bool is_zero = std::all_of(inertia.begin(), inertia.end(), [](double value) { return value == 0.0; });
        return is_zero ? "" : "the mass is zero, but first moments or second moments are not";
    }
    const auto point = point_mass(mass, inertia.data() + 1); // the rest is about the centre of mass (Steiner's theorem)
    const double largest = std::max({inertia[4], inertia[7], inertia[9], point[4], point[7], point[9]});
    const double tolerance = inertia_tolerance * largest;
    const double xx = inertia[4] - point[4] + tolerance;
    const double xy = inertia[5] - point[5];
    const double xz = inertia[6] - point[6];
    const double yy = inertia[7] - point[7] + tolerance;
    const double yz = inertia[8] - point[8];
    const double zz = inertia[9] - point[9] + tolerance;
    // the principal minors of a positive semidefinite matrix are not negative
    const double determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    const bool is_definite = xx >= 0.0 && yy >= 0.0 && zz >= 0.0 && xx * yy - xy * xy >= 0.0
        && xx * zz - xz * xz >= 0.0 && yy * zz - yz * yz >= 0.0 && determinant >= 0.0;
    return is_definite ? "" : "no body has these second moments: those about the origin of the frame are at least "
                              "those of a point mass at the centre of mass";
}

} // namespace robot_dynamics_control

#endif
