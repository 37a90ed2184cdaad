// No call of the control loop allocates: malloc and its kin count, whoever calls them.

#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <limits>

#include "check.hpp"
#include "counted_allocations.hpp"
#include "four_bar_control_model.h"
#include "loaded_panda_control_model.h"
#include "manutec_r3_control_model.h"
#include "robot_dynamics_control/law.hpp"
#include "slow_springs_control_model.h"

using namespace robot_dynamics_control;

namespace {

/// All that a control loop may call, in each mode.
void run_loop(Law& law, Settings& settings, const std::vector<double>& point)
{
    const std::size_t size = law.size();
    const double inertia[10] = {1.0, 0.1, 0.0, 0.2, 0.1, 0.0, 0.0, 0.1, 0.0, 0.1};
    double now = 0.0;
    for (const Mode mode : {Mode::gravity_compensation, Mode::feedforward, Mode::computed_torque, Mode::pd_gravity}) {
        for (const NoReferenceAction action :
            {NoReferenceAction::gravity, NoReferenceAction::damp, NoReferenceAction::zero}) {
            settings.mode = mode;
            settings.without_reference = action;
            law.apply(settings);
            for (int k = 0; k < 300; ++k) {
                now += 0.001;
                if (k % 100 > 30) {
                    const double* values = point.data();
                    law.track_point(now, now, {{values, size}, {values + size, size}, {values + 2 * size, size}});
                }
                if (k == 150) {
                    law.set_payload({inertia, 10});
                }
                if (k == 200) {
                    now += 0.5; // a stall
                }
                law.watchdog().record_latency(k % 7 == 0 ? 0.1 : 0.0);
                law.step(now);
            }
            law.control_law().q()[0] += std::numeric_limits<double>::quiet_NaN();
            law.step(now += 0.001);
            law.control_law().q()[0] = 1.2;
            law.reject_state(now += 0.001, "a test rejects it");
            law.tick(now += 0.1);
            law.handle_overdue_efforts(now += 0.001);
            law.halt("a test halts it");
            law.end_reference();
            law.step(now - 5.0);
        }
        law.restart();
        law.control_law().close_loops();
    }
}

void check_robot(const robot_dynamics_model* table)
{
    Model model;
    CHECK(model.bind(table).empty());
    ControlLaw joints;
    CHECK(joints.configure(model).empty());
    Law law;
    Settings settings;
    settings.limits.assign(joints.size(), 100.0);
    CHECK(law.configure(model, {}, settings).empty());
    settings = law.settings();
    law.control_law().q()[0] = 1.2;
    const std::vector<double> point(3 * law.size(), 1.0);
    allocations = 0;
    is_counting = true;
    run_loop(law, settings, point);
    is_counting = false;
    CHECK(allocations == 0);
}

} // namespace

int main()
{
    is_counting = true;
    std::free(std::malloc(8));
    delete new int(1);
    is_counting = false;
    CHECK(allocations == 2); // the counter works
    check_robot(loaded_panda_control_model());
    check_robot(four_bar_control_model());
    check_robot(manutec_r3_control_model());
    check_robot(slow_springs_control_model());
    return report();
}
