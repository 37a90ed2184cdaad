// Prints names of joints and limits of their positions.

#include <cstdio>

#include <robot_dynamics_control/model.hpp>

#include "arm_control_model.h"

int main()
{
    robot_dynamics_control::Model model;
    const std::string error = model.bind(arm_control_model());
    for (std::size_t i = 0; error.empty() && i < model.joint_count(); ++i) {
        std::printf("%s %g\n", model.joint(i).name, model.joint(i).upper);
    }
    return error.empty() ? 0 : 1;
}
