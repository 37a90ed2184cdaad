// The controller without a controller manager: its updates allocate nothing, and what they write. It needs ros2_control.
//
// Usage: controller_update_test PANDA FOUR_BAR, the model libraries; that of the Panda with a payload at panda_link8

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <controller_interface/chainable_controller_interface.hpp>
#include <pluginlib/class_loader.hpp>
#include <rclcpp/rclcpp.hpp>

#include "check.hpp"
#include "counted_allocations.hpp"

namespace {

using controller_interface::ChainableControllerInterface;
using hardware_interface::CommandInterface;
using hardware_interface::StateInterface;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr std::int64_t period = 1'000'000; // [ns]
const std::vector<double> posture{0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8};

/// A controller and interfaces of its own.
class Bench {
public:
    explicit Bench(const std::string& library)
        : loader_("controller_interface", "controller_interface::ChainableControllerInterface"),
          controller_(loader_.createSharedInstance("robot_dynamics_control/ComputedTorqueController"))
    {
        controller_interface::ControllerInterfaceParams params;
        params.controller_name = "arm";
        params.controller_manager_update_rate = 1000;
        params.node_options = controller_->define_custom_node_options();
        params.node_options.parameter_overrides({rclcpp::Parameter("model_library", library),
            rclcpp::Parameter("start_efforts", "gravity"), rclcpp::Parameter("state_rate", 1000.0)});
        CHECK(controller_->init(params) == controller_interface::return_type::OK);
        CHECK(controller_->configure().label() == "inactive");
        for (const std::string& name : controller_->state_interface_configuration().names) {
            states_.push_back(make_interface<StateInterface>(name));
        }
        for (const std::string& name : controller_->command_interface_configuration().names) {
            commands_.push_back(make_interface<CommandInterface>(name));
        }
        references_ = controller_->export_reference_interfaces();
    }

    void activate(bool is_chained)
    {
        std::vector<hardware_interface::LoanedCommandInterface> commands;
        std::vector<hardware_interface::LoanedStateInterface> states;
        for (const auto& interface : commands_) {
            commands.emplace_back(interface, [] {});
        }
        for (const auto& interface : states_) {
            states.emplace_back(interface, [] {});
        }
        controller_->assign_interfaces(std::move(commands), std::move(states));
        CHECK(controller_->set_chained_mode(is_chained));
        CHECK(controller_->get_node()->activate().label() == "active");
    }

    void deactivate()
    {
        CHECK(controller_->get_node()->deactivate().label() == "inactive");
        controller_->release_interfaces();
    }

    void move_to(const std::vector<double>& positions)
    {
        for (std::size_t i = 0; i < positions.size(); ++i) {
            set(*states_[i], positions[i]);
            set(*states_[positions.size() + i], 0.0);
        }
    }

    void write_references(const std::vector<double>& positions)
    {
        for (std::size_t i = 0; i < positions.size(); ++i) {
            set(*references_[i], positions[i]);
            set(*references_[positions.size() + i], 0.0);
        }
    }

    /// One update, whose allocations count.
    controller_interface::return_type update()
    {
        time_ += period;
        const rclcpp::Time time(time_, RCL_STEADY_TIME);
        const rclcpp::Duration duration(0, period);
        is_counting = true;
        const auto result = controller_->update(time, duration);
        is_counting = false;
        return result;
    }

    std::vector<double> efforts() const
    {
        std::vector<double> values;
        for (const auto& interface : commands_) {
            values.push_back(interface->get_optional().value());
        }
        return values;
    }

    void pause(std::int64_t duration) { time_ += duration; }

    bool set_parameter(const rclcpp::Parameter& parameter)
    {
        return controller_->get_node()->set_parameter(parameter).successful;
    }

private:
    template <typename Interface>
    static std::shared_ptr<Interface> make_interface(const std::string& name)
    {
        const std::size_t slash = name.rfind('/');
        auto interface = std::make_shared<Interface>(name.substr(0, slash), name.substr(slash + 1));
        set(*interface, nan);
        return interface;
    }

    template <typename Interface>
    static void set(Interface& interface, double value)
    {
        CHECK(interface.set_value(value));
    }

    pluginlib::ClassLoader<ChainableControllerInterface> loader_;
    std::shared_ptr<ChainableControllerInterface> controller_;
    std::vector<StateInterface::SharedPtr> states_;
    std::vector<CommandInterface::SharedPtr> commands_;
    std::vector<CommandInterface::SharedPtr> references_;
    std::int64_t time_ = 5'000'000'000;
};

bool are_near(const std::vector<double>& values, const std::vector<double>& expected, double tolerance)
{
    bool is_near = values.size() == expected.size();
    for (std::size_t i = 0; is_near && i < values.size(); ++i) {
        is_near = near(values[i], expected[i], tolerance);
    }
    return is_near;
}

double largest(const std::vector<double>& values)
{
    double found = 0.0;
    for (const double value : values) {
        found = std::max(found, std::abs(value));
    }
    return found;
}

void test_chain(Bench& bench)
{
    bench.activate(true);
    const std::vector<double> gravity = bench.efforts(); // start_efforts
    CHECK(largest(gravity) > 15.0);
    for (int step = 0; step < 200; ++step) {
        bench.write_references(posture);
        CHECK(bench.update() == controller_interface::return_type::OK);
        CHECK(are_near(bench.efforts(), gravity, 1e-9)); // at rest, at the reference
    }

    // a positive error gives a positive effort; a reference that is not written any more expires, and the robot is held
    std::vector<double> reference = posture;
    reference[0] += 0.1;
    const auto push = [&] {
        for (int step = 0; step < 200; ++step) {
            bench.write_references(reference);
            bench.update();
        }
    };
    push();
    CHECK(bench.efforts()[0] > 1.0);
    for (int step = 0; step < 300; ++step) {
        bench.update();
    }
    CHECK(are_near(bench.efforts(), gravity, 1e-9));

    // a restart in the same moment, as when a controller is chained or not, keeps the efforts
    push();
    const std::vector<double> before = bench.efforts();
    CHECK(before[0] > 1.0);
    bench.deactivate();
    CHECK(largest(bench.efforts()) == 0.0);
    bench.activate(false);
    CHECK(are_near(bench.efforts(), before, 0.0));
    bench.update();
    CHECK(are_near(bench.efforts(), before, 1e-9));
}

void test_faults(Bench& bench)
{
    for (int step = 0; step < 200; ++step) {
        bench.update();
    }
    std::vector<double> broken = posture;
    broken[3] = nan;
    const double start = largest(bench.efforts());
    bench.move_to(broken);
    double before = start;
    for (int step = 0; step < 110; ++step) {
        CHECK(bench.update() == controller_interface::return_type::OK);
        const double effort = largest(bench.efforts());
        CHECK(std::isfinite(effort) && effort <= before + 1e-12 && effort > before - 0.011 * start);
        before = effort;
    }
    CHECK(before == 0.0);
    CHECK(bench.set_parameter(rclcpp::Parameter("error_on_fault", true)));
    CHECK(bench.update() == controller_interface::return_type::ERROR);
    CHECK(bench.set_parameter(rclcpp::Parameter("error_on_fault", false)));
    bench.move_to(posture);
    for (int step = 0; step < 110; ++step) {
        bench.update();
    }
    CHECK(near(largest(bench.efforts()), start, 1e-9));

    bench.pause(200'000'000); // longer than state_timeout and ramp_time
    bench.update();
    CHECK(largest(bench.efforts()) == 0.0);
    for (int step = 0; step < 110; ++step) {
        bench.update();
    }
    CHECK(near(largest(bench.efforts()), start, 1e-9));
}

void test_payload(Bench& bench)
{
    const std::vector<double> before = bench.efforts();
    CHECK(!bench.set_parameter(rclcpp::Parameter("payload.mass", nan)));
    CHECK(!bench.set_parameter(rclcpp::Parameter("kp", std::vector<double>{1.0, 2.0})));
    CHECK(!bench.set_parameter(rclcpp::Parameter("state_timeout", 0.001)));
    CHECK(bench.set_parameter(rclcpp::Parameter("payload.mass", 2.0)));
    bench.update();
    CHECK(are_near(bench.efforts(), before, 1e-9)); // no jump
    for (int step = 0; step < 110; ++step) {
        bench.update();
    }
    // a mass on the flange of a Panda in this posture loads the shoulder and the elbow
    CHECK(std::abs(bench.efforts()[1] - before[1]) > 5.0 && std::abs(bench.efforts()[3] - before[3]) > 5.0);
    CHECK(near(bench.efforts()[0], before[0], 1e-9)); // its axis is vertical
}

/// A robot with loops is held as well, at the position at which its description closes the loops.
void test_loops(Bench& bench)
{
    bench.move_to({1.0});
    bench.activate(false);
    const std::vector<double> gravity = bench.efforts();
    CHECK(gravity.size() == 1 && std::abs(gravity[0]) > 1e-3);
    for (int step = 0; step < 200; ++step) {
        CHECK(bench.update() == controller_interface::return_type::OK);
        CHECK(are_near(bench.efforts(), gravity, 1e-9));
    }
    bench.deactivate();
}

void time_updates(Bench& bench, int count)
{
    std::vector<double> times;
    times.reserve(static_cast<std::size_t>(count));
    for (int step = 0; step < count; ++step) {
        const auto begin = std::chrono::steady_clock::now();
        bench.update();
        times.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count());
    }
    std::sort(times.begin(), times.end());
    std::printf("%d updates: median %.2f us, 99 %% %.2f us, largest %.2f us\n", count, times[times.size() / 2],
        times[times.size() * 99 / 100], times.back());
}

} // namespace

int main(int argc, char** argv)
{
    if (argc < 3) {
        std::printf("usage: controller_update_test PANDA FOUR_BAR\n");
        return 2;
    }
    rclcpp::init(argc, argv);
    {
        Bench bench(argv[1]);
        bench.move_to(posture);
        test_chain(bench);
        test_faults(bench);
        test_payload(bench);
        time_updates(bench, 100000);
        bench.deactivate();
        Bench linkage(argv[2]);
        test_loops(linkage);
    }
    rclcpp::shutdown();
    CHECK(allocations == 0);
    std::printf("%lu allocations\n", allocations);
    return report();
}
