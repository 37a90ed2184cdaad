// A restart from efforts that are in force: the first efforts are these, and those of the mode follow in ramp_time.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "check.hpp"
#include "panda_control_model.h"
#include "robot_dynamics_control/law.hpp"

using namespace robot_dynamics_control;

int main()
{
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    const std::vector<double> posture{0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8};
    Model model;
    CHECK(model.bind(panda_control_model()).empty());
    Settings settings;
    settings.ramp_time = 0.1;
    Law law;
    CHECK(law.configure(model, {}, settings).empty());
    std::copy(posture.begin(), posture.end(), law.control_law().q().begin());
    std::vector<double> gravity(law.size());
    CHECK(law.control_law().gravity_compensation(gravity));

    // joint 1 is limited to 87 N m, joint 2 has no effort that is known
    const std::vector<double> efforts{100.0, nan, 1.0, -2.0, 3.0, -4.0, 5.0};
    const std::vector<double> first{87.0, 0.0, 1.0, -2.0, 3.0, -4.0, 5.0};
    law.restart(efforts);
    CHECK(law.activity() == Activity::none);
    for (std::size_t i = 0; i < law.size(); ++i) {
        CHECK(law.last_efforts()[i] == first[i]);
    }
    double now = 5.0;
    for (int step = 0; step <= 100; ++step, now += 1e-3) {
        const Numbers sent = law.step(now);
        const double part = std::max(0.0, 1.0 - step * 1e-2);
        for (std::size_t i = 0; i < law.size(); ++i) {
            CHECK(near(sent[i], gravity[i] + part * (first[i] - gravity[i]), 1e-9));
        }
    }

    // another reference takes the place of one that has ended, between two steps: the efforts depart from the last ones
    settings.mode = Mode::computed_torque;
    settings.kp.assign(law.size(), 400.0);
    settings.kd.assign(law.size(), 40.0);
    CHECK(law.apply(Law::complete(settings, law.control_law())));
    const std::vector<double> still(law.size());
    std::vector<double> ahead = posture;
    ahead[0] += 0.2;
    for (int step = 0; step <= 200; ++step, now += 1e-3) {
        CHECK(law.track_point(now, now, {posture, still, still}) == PointResult::accepted);
        law.step(now);
    }
    const std::vector<double> before(law.last_efforts().begin(), law.last_efforts().end());
    law.end_reference();
    law.start_transition();
    CHECK(law.track_point(now, now, {ahead, still, still}) == PointResult::accepted);
    law.step(now);
    for (std::size_t i = 0; i < law.size(); ++i) {
        CHECK(near(law.last_efforts()[i], before[i], 1e-9));
    }
    for (int step = 0; step <= 100; ++step, now += 1e-3) {
        CHECK(law.track_point(now, now, {ahead, still, still}) == PointResult::accepted);
        law.step(now);
    }
    CHECK(law.last_efforts()[0] > before[0] + 10.0);

    // without efforts all are zero
    law.restart();
    for (const double effort : law.last_efforts()) {
        CHECK(effort == 0.0);
    }
    CHECK(near(law.step(0.0)[1], 0.0));
    return report();
}
