// Times of updates: the median and the longest of many, for the Panda, a robot with loops and one with springs. The longest one is
// that of the machine: of its interrupts and other processes.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "four_bar_control_model.h"
#include "loaded_panda_control_model.h"
#include "manutec_r3_control_model.h"
#include "panda_control_model.h"
#include "robot_dynamics_control/law.hpp"

using namespace robot_dynamics_control;

namespace {

void measure(const char* name, const robot_dynamics_model* table, Mode mode, const std::vector<double>& posture,
    std::size_t count)
{
    Model model;
    Law law;
    Settings settings;
    settings.mode = mode;
    std::string error = model.bind(table);
    settings.kp.assign(posture.size(), 100.0);
    settings.kd.assign(posture.size(), 20.0);
    error = error.empty() ? law.configure(model, {}, settings) : error;
    if (!error.empty()) {
        std::printf("%s: %s\n", name, error.c_str());
        std::exit(1);
    }
    const std::size_t size = law.size();
    std::vector<double> point(3 * size, 0.0);
    std::vector<float> times(count); // [us]
    double sum = 0.0;
    for (std::size_t k = 0; k < count; ++k) {
        const double now = 0.001 * static_cast<double>(k);
        for (std::size_t i = 0; i < size; ++i) {
            const double swing = 0.1 * std::sin(now + static_cast<double>(i));
            point[i] = posture[i] + swing;
            const std::size_t joint = law.control_law().joint_index(i);
            law.control_law().q()[joint] = posture[i] + 0.99 * swing;
            law.control_law().qd()[joint] = 0.1 * std::cos(now + static_cast<double>(i));
        }
        const auto begin = std::chrono::steady_clock::now();
        law.track_point(now, now, {{point.data(), size}, {point.data() + size, size}, {point.data() + 2 * size, size}});
        sum += law.step(now)[0];
        times[k] = std::chrono::duration<float, std::micro>(std::chrono::steady_clock::now() - begin).count();
    }
    std::sort(times.begin(), times.end());
    std::printf("%-12s %-20s %8zu updates: median %6.2f us, 99.9 %% %6.2f us, longest %8.2f us%s\n", name,
        to_string(mode), count, static_cast<double>(times[count / 2]), static_cast<double>(times[count * 999 / 1000]),
        static_cast<double>(times.back()), std::isfinite(sum) ? "" : " not finite");
}

} // namespace

int main(int count, char** arguments)
{
    const std::size_t updates = count > 1 ? std::strtoul(arguments[1], nullptr, 10) : 1'000'000;
    const std::vector<double> arm = {0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8};
    for (const Mode mode : {Mode::gravity_compensation, Mode::computed_torque}) {
        measure("panda", panda_control_model(), mode, arm, updates);
    }
    measure("with payload", loaded_panda_control_model(), Mode::computed_torque, arm, updates);
    measure("four_bar", four_bar_control_model(), Mode::computed_torque, {1.0}, updates);
    measure("manutec_r3", manutec_r3_control_model(), Mode::computed_torque, std::vector<double>(6, 0.5), updates);
    return 0;
}
