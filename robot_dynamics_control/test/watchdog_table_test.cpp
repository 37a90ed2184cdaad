// The table of docs/explanation/watchdog.md, row by row, as far as the rows are those of the law: what becomes of the
// efforts of a Panda that is held against gravity.

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "check.hpp"
#include "panda_control_model.h"
#include "robot_dynamics_control/law.hpp"
#include "robot_dynamics_control/transit_times.hpp"

using namespace robot_dynamics_control;

namespace {

constexpr double q[7] = {0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8};
constexpr double held = -16.6606; // effort of joint 2 that holds the arm [N m]
constexpr double cycle = 0.001;

/// A law of a Panda whose state and clock tests set.
struct Robot {
    Law law;
    double now = 0.0;

    explicit Robot(Mode mode = Mode::gravity_compensation, NoReferenceAction action = NoReferenceAction::damp)
    {
        Model model;
        model.bind(panda_control_model());
        Settings settings;
        settings.mode = mode;
        settings.without_reference = action;
        settings.kp.assign(7, 100.0);
        settings.kd.assign(7, 20.0);
        CHECK(law.configure(model, {}, settings).empty());
        set_state(0.0);
    }

    void set_state(double velocity)
    {
        std::copy(q, q + 7, law.control_law().q().begin());
        std::fill(law.control_law().qd().begin(), law.control_law().qd().end(), velocity);
    }

    double effort() const { return law.last_efforts()[1]; }

    /// Good states for some time [s].
    void run(double seconds)
    {
        for (const double end = now + seconds; now < end - cycle / 2;) {
            now += cycle;
            law.step(now);
        }
    }

    /// Rejected states for some time [s].
    void run_bad(double seconds)
    {
        for (const double end = now + seconds; now < end - cycle / 2;) {
            now += cycle;
            law.reject_state(now, "a joint is missing");
        }
    }

    /// No states for some time [s].
    void tick(double seconds)
    {
        for (const double end = now + seconds; now < end - cycle / 2;) {
            now += cycle;
            law.tick(now);
        }
    }

    bool has_state_of_rest() const { return near(effort(), held, 1e-3) && law.fault() == Fault::none; }
    bool is_zero() const
    {
        const Numbers efforts = law.last_efforts();
        return std::all_of(efforts.begin(), efforts.end(), [](double effort) { return effort == 0.0; });
    }

    PointResult track(double position = 0.0)
    {
        const double zeros[7] = {};
        double positions[7];
        std::copy(q, q + 7, positions);
        positions[1] += position;
        return law.track_point(now, now, {{positions, 7}, {zeros, 7}, {zeros, 7}});
    }
};

void first_efforts_begin_with_a_ramp()
{
    Robot robot;
    robot.run(cycle);
    CHECK(robot.is_zero());
    robot.run(0.05);
    CHECK(near(robot.effort(), held / 2, 1e-3));
    robot.run(0.1);
    CHECK(robot.has_state_of_rest());
    CHECK(robot.law.activity() == Activity::gravity_compensation);
}

void no_state_for_state_timeout()
{
    Robot robot;
    robot.run(0.2);
    robot.tick(0.019);
    CHECK(robot.has_state_of_rest()); // not yet stale
    robot.tick(0.051);
    CHECK(robot.law.fault() == Fault::stale && robot.law.activity() == Activity::fault);
    CHECK(near(robot.effort(), held / 2, 0.2));
    robot.tick(0.051);
    CHECK(robot.is_zero());
    robot.tick(0.5);
    CHECK(robot.is_zero() && robot.law.fault() == Fault::stale);
    robot.run(0.051);
    CHECK(near(robot.effort(), held / 2, 0.2)); // they come back in ramp_time
    robot.run(0.1);
    CHECK(robot.has_state_of_rest());
}

void state_that_is_not_finite_or_incomplete()
{
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    for (const double bad : {nan, std::numeric_limits<double>::infinity(), 1e200}) {
        for (const bool in_velocities : {false, true}) {
            Robot robot;
            robot.run(0.2);
            MutableNumbers values = in_velocities ? robot.law.control_law().qd() : robot.law.control_law().q();
            values[4] = bad;
            robot.run(cycle);
            CHECK(robot.law.fault() == Fault::rejected);
            CHECK(std::abs(robot.effort()) <= std::abs(held) && std::isfinite(robot.effort()));
            robot.run(0.102);
            CHECK(robot.is_zero());
            robot.set_state(0.0);
            robot.run(0.102);
            CHECK(robot.has_state_of_rest());
        }
    }
    Robot robot;
    robot.run(0.2);
    robot.run_bad(cycle);
    CHECK(robot.law.describe_fault() == "a joint is missing");
    robot.run_bad(0.102);
    CHECK(robot.is_zero());
    robot.tick(0.021);
    CHECK(robot.law.fault() == Fault::stale); // the reason is then silence
}

void state_with_an_old_stamp_or_a_long_transit()
{
    Robot robot;
    robot.run(0.2);
    robot.now += cycle;
    robot.law.step(robot.now, robot.now, robot.now - 0.019);
    CHECK(robot.law.fault() == Fault::none);
    robot.now += cycle;
    robot.law.step(robot.now, robot.now, robot.now - 0.021);
    CHECK(robot.law.fault() == Fault::stale);
    CHECK(near(robot.effort(), held * 0.99, 1e-3)); // the ramp began when that state became stale, 1 ms ago

    TransitTimes transit;
    CHECK(near(transit.delay(1'000'000'000, 0), 0.0)); // no time of publication
    CHECK(near(transit.delay(1'005'000'000, 1'000'000'000), 0.0)); // the clocks differ by 5 ms
    CHECK(near(transit.delay(1'046'000'000, 1'011'000'000), 0.030));
    CHECK(near(transit.delay(1'050'000'000, 1'047'000'000), 0.0)); // faster than the fastest one before
}

void state_with_a_stamp_ahead_of_the_clock()
{
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    for (const double ahead : {5.0, 0.03, std::numeric_limits<double>::infinity(), nan}) {
        for (const bool is_published : {false, true}) {
            Robot robot;
            robot.run(0.2);
            const double stamp = robot.now + ahead;
            robot.law.step(robot.now, is_published ? robot.now : stamp, is_published ? stamp : robot.now);
            CHECK(robot.law.fault() == Fault::rejected);
            CHECK(contains(robot.law.describe_fault(), std::isfinite(ahead) ? "ahead of the clock" : "is not finite"));
            robot.tick(0.2);
            CHECK(robot.is_zero() && robot.law.fault() == Fault::stale);
            robot.run(0.11);
            CHECK(robot.has_state_of_rest());
        }
    }
    Robot robot;
    robot.run(0.2);
    robot.law.step(robot.now, robot.now + 0.019, robot.now + 0.019);
    CHECK(robot.has_state_of_rest());
}

void state_that_was_measured_too_long_ago()
{
    Robot robot;
    robot.run(0.2);
    robot.law.step(robot.now, robot.now - 0.021, robot.now);
    CHECK(robot.law.fault() == Fault::rejected);
    CHECK(contains(robot.law.describe_fault(), "measured more than state_timeout ago"));
    robot.run(0.11);
    CHECK(robot.has_state_of_rest());
    robot.law.step(robot.now, robot.now - 0.019, robot.now);
    CHECK(robot.has_state_of_rest());
}

void clock_steps_back_a_little()
{
    Robot robot;
    robot.run(0.2);
    const double sent = robot.effort();
    robot.law.reject_state(robot.now, "a test");
    CHECK(near(robot.effort(), sent, 1e-3 * std::abs(sent)));
    robot.law.reject_state(robot.now - 1e-4, "a test"); // another thread has read the clock before
    CHECK(near(robot.effort(), sent, 1e-3 * std::abs(sent)));
}

void every_second_state_is_invalid()
{
    Robot robot;
    robot.run(0.2);
    double before = robot.effort();
    for (int count = 0; count < 1000; ++count) {
        robot.now += cycle;
        if (count % 2 == 0) {
            robot.law.reject_state(robot.now, "a test");
        } else {
            robot.law.step(robot.now);
        }
        CHECK(near(robot.effort(), before, 0.011 * std::abs(before)));
        before = robot.effort();
    }
    CHECK(std::abs(before) < 0.3); // 0.99 to the power of 500, of 32 N m
    robot.run(0.11);
    CHECK(robot.has_state_of_rest());
}

void settings_and_payload_are_passed_in_every_cycle()
{
    Robot robot;
    Robot expected;
    robot.run(0.05);
    expected.run(0.05);
    for (int count = 0; count < 200; ++count) {
        CHECK(robot.law.apply(robot.law.settings()));
        robot.run(cycle);
        expected.run(cycle);
        CHECK(robot.effort() == expected.effort());
    }
    Settings settings = robot.law.settings();
    settings.limits[0] = -1.0;
    CHECK(!robot.law.apply(settings));
}

void law_without_a_model()
{
    Law law;
    CHECK(law.step(1.0).empty());
    CHECK(contains(law.describe_fault(), "not configured"));
}

void late_efforts_for_ever()
{
    Watchdog watchdog;
    watchdog.set(0.02, 0.005, std::numeric_limits<int>::max());
    for (int count = 0; count < 3; ++count) {
        watchdog.record_latency(std::numeric_limits<double>::quiet_NaN());
    }
    watchdog.set(0.02, 0.005, 3);
    watchdog.check_clock(1.0);
    watchdog.accept_state(1.0);
    CHECK(watchdog.fault(1.0) == Fault::late);
    watchdog.record_latency(1.0);
    CHECK(watchdog.fault(1.0) == Fault::late);
    watchdog.record_latency(0.004);
    CHECK(watchdog.fault(1.0) == Fault::none);
}

void clock_that_is_not_finite()
{
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
        const auto calls = {+[](Law& law, double now) { law.step(now); }, +[](Law& law, double now) { law.tick(now); },
            +[](Law& law, double now) { law.reject_state(now, "a test"); },
            +[](Law& law, double now) { law.handle_overdue_efforts(now); }};
        for (const auto call : calls) {
            Robot robot;
            robot.run(0.2);
            call(robot.law, bad);
            CHECK(robot.is_zero() && robot.law.fault() == Fault::rejected);
            CHECK(contains(robot.law.describe_fault(), "clock is not finite"));
            robot.tick(cycle);
            CHECK(robot.is_zero() && robot.law.fault() != Fault::none);
            robot.run(0.11);
            CHECK(robot.has_state_of_rest());
        }
    }
}

void program_stalls_or_its_clock_jumps_ahead()
{
    Robot robot;
    robot.run(0.2);
    robot.now += 0.060;
    robot.law.step(robot.now);
    CHECK(robot.law.fault() == Fault::stalled && robot.law.watchdog().stall_count() == 1);
    CHECK(near(robot.effort(), held * 0.6, 1e-3)); // counted from state_timeout after the last state
    robot.run(0.102);
    CHECK(robot.has_state_of_rest());

    robot.now += 0.5; // longer than the ramp
    robot.law.step(robot.now);
    CHECK(robot.is_zero() && robot.law.watchdog().stall_count() == 2);
}

void clock_jumps_back()
{
    for (const bool ends_by_reference : {true, false}) {
        Robot robot(Mode::computed_torque, NoReferenceAction::gravity);
        robot.run(0.2);
        robot.now -= 0.1;
        robot.law.step(robot.now);
        CHECK(robot.law.fault() == Fault::clock_jumped_back);
        robot.run(0.3);
        CHECK(robot.is_zero() && robot.law.fault() == Fault::clock_jumped_back); // good states do not end it
        if (ends_by_reference) {
            CHECK(robot.track() == PointResult::accepted);
        } else {
            Settings settings = robot.law.settings();
            settings.mode = Mode::gravity_compensation;
            CHECK(robot.law.apply(settings));
        }
        robot.run(cycle);
        CHECK(robot.law.fault() == Fault::none);
        robot.law.restart();
        CHECK(robot.law.fault() == Fault::none && robot.is_zero());
    }
    Robot robot;
    robot.run(0.2);
    robot.now -= 0.015; // less than the timeout
    robot.law.step(robot.now);
    CHECK(robot.law.fault() == Fault::none);
}

void clock_stands_still_or_sending_is_too_slow()
{
    Robot robot;
    robot.run(0.2);
    robot.law.halt("the clock stands still");
    CHECK(robot.is_zero() && robot.law.describe_fault() == "the clock stands still");
    robot.run(0.102);
    CHECK(robot.has_state_of_rest());

    robot.now += cycle;
    robot.law.handle_overdue_efforts(robot.now);
    CHECK(robot.law.fault() == Fault::rejected);
    robot.run(0.2);
    CHECK(robot.has_state_of_rest());
}

void description_that_does_not_fit()
{
    Robot robot;
    robot.run(0.2);
    robot.law.watchdog().block(true);
    robot.run(0.102);
    CHECK(robot.is_zero() && robot.law.fault() == Fault::blocked);
    CHECK(robot.track() == PointResult::accepted);
    robot.run(0.01);
    CHECK(robot.law.fault() == Fault::blocked); // a reference does not end it
    robot.law.watchdog().block(false);
    robot.run(0.102);
    CHECK(robot.has_state_of_rest());
}

void late_efforts_in_a_row()
{
    Robot robot;
    robot.run(0.2);
    for (int miss = 0; miss < 9; ++miss) {
        robot.law.watchdog().record_latency(0.006);
    }
    robot.run(cycle);
    CHECK(robot.law.fault() == Fault::none);
    robot.law.watchdog().record_latency(0.006);
    robot.run(0.102);
    CHECK(robot.law.fault() == Fault::late && robot.is_zero());
    robot.law.watchdog().record_latency(0.004);
    robot.run(0.102);
    CHECK(robot.has_state_of_rest());
}

void no_reference()
{
    for (const NoReferenceAction action :
        {NoReferenceAction::gravity, NoReferenceAction::damp, NoReferenceAction::zero}) {
        for (const Mode mode : {Mode::computed_torque, Mode::feedforward, Mode::pd_gravity}) {
            Robot robot(mode, action);
            robot.run(0.2);
            CHECK(robot.law.no_reference() == NoReference::none_yet);
            CHECK(near(robot.effort(), action == NoReferenceAction::zero ? 0.0 : held, 1e-3));
            CHECK(robot.track(0.1) == PointResult::accepted);
            robot.run(0.098);
            CHECK(robot.law.no_reference() == NoReference::none);
            CHECK(std::string(to_string(robot.law.activity())) == to_string(mode));
            robot.run(0.004);
            CHECK(robot.law.no_reference() == NoReference::timed_out);
            robot.set_state(0.5);
            robot.run(0.2);
            const bool brakes = std::abs(robot.effort() - held) > 1.0;
            CHECK(brakes == (action != NoReferenceAction::gravity));
            CHECK(action != NoReferenceAction::zero || robot.is_zero());
        }
    }
}

void effort_beyond_its_limit()
{
    Robot robot(Mode::computed_torque, NoReferenceAction::gravity);
    Settings settings = robot.law.settings();
    settings.limits.assign(7, 10.0);
    settings.limits[0] = std::numeric_limits<double>::infinity();
    CHECK(robot.law.apply(settings));
    robot.run(0.2);
    CHECK(near(robot.effort(), -10.0) && robot.law.is_saturated(1) && !robot.law.is_saturated(0));
}

void reference_that_is_wrong()
{
    Robot robot(Mode::computed_torque, NoReferenceAction::gravity);
    robot.run(0.2);
    CHECK(robot.track(0.1) == PointResult::accepted);
    robot.run(0.01);
    const double zeros[7] = {};
    double positions[7];
    std::copy(q, q + 7, positions);
    positions[3] = 0.5; // the limit is -0.0698
    CHECK(robot.law.track_point(robot.now, robot.now, {{positions, 7}, {zeros, 7}, {zeros, 7}})
        == PointResult::beyond_limits);
    CHECK(robot.law.offending_joint() == 3);
    positions[3] = std::numeric_limits<double>::quiet_NaN();
    CHECK(robot.law.track_point(robot.now, robot.now, {{positions, 7}, {zeros, 7}, {zeros, 7}})
        == PointResult::not_finite);
    CHECK(robot.law.track_point(robot.now, robot.now, {{zeros, 6}, {zeros, 7}, {zeros, 7}}) == PointResult::wrong_size);
    CHECK(robot.law.track_point(robot.now, robot.now - 0.2, {{q, 7}, {zeros, 7}, {zeros, 7}}) == PointResult::too_old);
    CHECK(robot.law.track_point(robot.now, robot.now + 0.2, {{q, 7}, {zeros, 7}, {zeros, 7}}) == PointResult::ahead);
    for (const double bad : {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
        CHECK(robot.law.track_point(robot.now, bad, {{q, 7}, {zeros, 7}, {zeros, 7}}) == PointResult::not_finite);
        CHECK(robot.law.track_point(-bad, robot.now, {{q, 7}, {zeros, 7}, {zeros, 7}}) == PointResult::not_finite);
    }
    robot.run(cycle);
    CHECK(robot.law.activity() == Activity::computed_torque); // the previous reference continues
    CHECK(near(robot.law.reference().positions[1], q[1] + 0.1));
}

void fault_drops_the_reference()
{
    Robot robot(Mode::computed_torque, NoReferenceAction::gravity);
    Settings settings = robot.law.settings();
    settings.reference_timeout = 10.0;
    CHECK(robot.law.apply(settings));
    robot.run(0.2);
    CHECK(robot.track(0.1) == PointResult::accepted);
    robot.run(0.05);
    robot.run_bad(cycle); // a single bad state
    robot.run(0.01);
    CHECK(robot.law.no_reference() == NoReference::none);
    robot.run_bad(0.102);
    CHECK(robot.law.no_reference() == NoReference::dropped);
    CHECK(robot.track(0.1) == PointResult::accepted); // received during the fault
    robot.run_bad(0.09);
    CHECK(robot.law.no_reference() == NoReference::none);
    robot.run_bad(0.02);
    CHECK(robot.law.no_reference() == NoReference::dropped);
    CHECK(robot.track() == PointResult::accepted);
    robot.law.end_reference();
    robot.run(0.2);
    CHECK(robot.law.no_reference() == NoReference::ended && robot.has_state_of_rest());
}

/// No fault and no change makes the efforts jump by more than the ramp allows.
void efforts_never_jump()
{
    Robot robot(Mode::computed_torque, NoReferenceAction::zero);
    double before = 0.0;
    double largest = 0.0;
    const auto observe = [&](auto act) {
        for (int k = 0; k < 60; ++k) {
            act();
            largest = std::max(largest, std::abs(robot.effort() - before));
            before = robot.effort();
        }
    };
    for (int round = 0; round < 5; ++round) {
        observe([&] { robot.run(cycle); });
        robot.track();
        observe([&] { robot.run(cycle); });
        observe([&] { robot.run_bad(cycle); });
        observe([&] { robot.tick(cycle); });
    }
    CHECK(largest > 0.0 && largest < 1.01 * std::abs(held) * cycle / 0.1);
}

} // namespace

int main()
{
    first_efforts_begin_with_a_ramp();
    no_state_for_state_timeout();
    state_that_is_not_finite_or_incomplete();
    state_with_an_old_stamp_or_a_long_transit();
    state_with_a_stamp_ahead_of_the_clock();
    state_that_was_measured_too_long_ago();
    clock_steps_back_a_little();
    every_second_state_is_invalid();
    settings_and_payload_are_passed_in_every_cycle();
    law_without_a_model();
    late_efforts_for_ever();
    clock_that_is_not_finite();
    program_stalls_or_its_clock_jumps_ahead();
    clock_jumps_back();
    clock_stands_still_or_sending_is_too_slow();
    description_that_does_not_fit();
    late_efforts_in_a_row();
    no_reference();
    effort_beyond_its_limit();
    reference_that_is_wrong();
    fault_drops_the_reference();
    efforts_never_jump();
    return report();
}
