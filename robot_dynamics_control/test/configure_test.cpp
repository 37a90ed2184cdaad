// What is refused at configuration, and in which words.

#include <cmath>
#include <limits>
#include <string>

#include "check.hpp"
#include "four_bar_control_model.h"
#include "panda_control_model.h"
#include "panda_models.hpp"
#include "robot_dynamics_control/law.hpp"
#include "robot_dynamics_control/model_library.hpp"

using namespace robot_dynamics_control;

namespace {

Model bound(const robot_dynamics_model* table)
{
    Model model;
    CHECK(model.bind(table).empty());
    return model;
}

void models()
{
    Model model;
    CHECK(!model.is_bound());
    CHECK(contains(model.bind(nullptr), "null pointer"));
    robot_dynamics_model other = *panda_control_model();
    other.abi = 99;
    CHECK(contains(model.bind(&other), "has version 99 of the interface, this program needs 2"));
    other.abi = ROBOT_DYNAMICS_MODEL_ABI;
    other.size = 8;
    CHECK(!model.bind(&other).empty() && !model.is_bound());
    CHECK(model.bind(panda_control_model()).empty());
    CHECK(model.robot() == "panda" && model.joint_count() == 7 && model.position_count() == 7);
    CHECK(std::string(model.joint(3).name) == "panda_joint4" && model.find_joint("panda_joint4") == 3);
    CHECK(model.find_joint("elbow") == 7);
    CHECK(near(model.joint(0).effort, 87.0) && near(model.joint(3).upper, -0.0698));

    const Model linkage = bound(four_bar_control_model());
    CHECK(linkage.has_loops() && linkage.joint_count() == 1 && linkage.position_count() == 4);
    CHECK(linkage.dependent_count() == 3 && std::string(linkage.dependent_name(2)) == "knee");
}

void joints()
{
    const Model panda = bound(panda_control_model());
    Law law;
    const Settings settings;
    CHECK(contains(law.configure(Model(), {}, settings), "bind it first"));
    CHECK(contains(law.configure(panda, {"elbow"}, settings), "'elbow' is no independent joint of 'panda'"));
    CHECK(contains(law.configure(panda, {"panda_joint1", "panda_joint1"}, settings), "named more than once"));
    const Model linkage = bound(four_bar_control_model());
    CHECK(contains(law.configure(linkage, {"rocker"}, settings), "whose independent joints are crank"));

    robot_dynamics_joint passive[7];
    std::copy(panda.table().joints, panda.table().joints + 7, passive);
    passive[2].actuated = 0;
    robot_dynamics_model table = panda.table();
    table.joints = passive;
    CHECK(contains(law.configure(bound(&table), {"panda_joint3"}, settings), "has no motor: leave it out"));
    CHECK(law.configure(bound(&table), {}, settings).empty() && law.size() == 6);
    for (auto& joint : passive) {
        joint.actuated = 0;
    }
    CHECK(contains(law.configure(bound(&table), {}, settings), "there is nothing to control"));

    CHECK(law.configure(panda, {"panda_joint4", "panda_joint2"}, settings).empty());
    CHECK(law.size() == 2 && law.control_law().joint_index(0) == 3 && law.control_law().joint_index(1) == 1);
    CHECK(near(law.settings().limits[0], 87.0)); // those of the description
    CHECK(!law.configure(panda, {"elbow"}, settings).empty() && law.size() == 2); // the configuration before it remains
}

void settings()
{
    const Model panda = bound(panda_control_model());
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const auto objection = [&](auto change) {
        Settings settings;
        change(settings);
        Law law;
        return law.configure(panda, {"panda_joint1", "panda_joint2"}, settings);
    };
    CHECK(objection([](Settings&) {}).empty());
    CHECK(contains(objection([](Settings& s) { s.kp = {1.0}; }), "kp has 1 numbers, 2 are needed"));
    CHECK(contains(objection([](Settings& s) { s.kd = {1.0, -1.0}; }), "kd has -1"));
    CHECK(contains(objection([&](Settings& s) { s.kp = {nan, 1.0}; }), "kp has nan"));
    CHECK(contains(objection([&](Settings& s) { s.limits = {nan, 1.0}; }), "limits has nan"));
    CHECK(contains(objection([](Settings& s) { s.limits = {0.0, 0.0}; }), "nothing but zeros"));
    CHECK(contains(objection([](Settings& s) { s.state_timeout = 0.0; }), "state_timeout is 0"));
    CHECK(contains(objection([&](Settings& s) { s.ramp_time = nan; }), "ramp_time is nan"));
    CHECK(contains(objection([](Settings& s) { s.deadline_misses = 0; }), "deadline_misses"));

    Law law;
    CHECK(law.configure(panda, {}, Settings()).empty());
    CHECK(!law.apply(Settings())); // its arrays are empty
    CHECK(law.apply(Law::complete(Settings(), law.control_law())));
    const double inertia[10] = {1.0};
    CHECK(!law.set_payload({inertia, 10})); // this model has none
    CHECK(!Law().set_payload({inertia, 10})); // there is no model yet
    Settings without_effort = Law::complete(Settings(), law.control_law());
    without_effort.limits.assign(law.size(), 0.0);
    CHECK(contains(find_objection(without_effort, law.size()), "nothing but zeros"));
}

void payloads()
{
    const auto objection = [](const std::vector<double>& inertia) { return std::string(find_objection_to_payload(inertia)); };
    // 2 kg with its centre at (0.1, 0, 0.05): a point mass, rounded to six digits, a body, and half of either moment
    const std::vector<double> point{2.0, 0.2, 0.0, 0.1, 0.005, 0.0, -0.01, 0.025, 0.0, 0.02};
    CHECK(objection(point).empty());
    const auto of_mass = point_mass(2.0, point.data() + 1);
    for (std::size_t k = 0; k < of_mass.size(); ++k) {
        CHECK(near(of_mass[k], point[k], 1e-16));
    }
    std::vector<double> changed = point;
    changed[4] = 0.00499999;
    CHECK(objection(changed).empty());
    changed[4] = 0.0049;
    CHECK(contains(objection(changed), "no body has these second moments"));
    changed = point;
    changed[6] = 0.01; // the sign of the product
    CHECK(contains(objection(changed), "no body has these second moments"));
    CHECK(contains(objection({2.0, 0.2, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0}), "no body has"));
    CHECK(objection({2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0}).empty());
    CHECK(objection(std::vector<double>(10, 0.0)).empty());
    CHECK(contains(objection({0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0}), "the mass is zero"));
    CHECK(contains(objection({-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0}), "negative"));
    CHECK(contains(objection({1.0, 0.0}), "10 numbers"));
    changed[2] = std::numeric_limits<double>::infinity();
    CHECK(contains(objection(changed), "not finite"));
}

void names()
{
    Mode mode = Mode::feedforward;
    CHECK(parse("computed_torque", mode) && mode == Mode::computed_torque);
    CHECK(!parse("torque", mode) && mode == Mode::computed_torque);
    NoReferenceAction action = NoReferenceAction::zero;
    CHECK(parse("damp", action) && action == NoReferenceAction::damp);
    FrictionVelocity velocity = FrictionVelocity::reference;
    CHECK(parse("measured", velocity) && velocity == FrictionVelocity::measured);
}

void libraries()
{
    ModelLibrary library;
    CHECK(contains(library.open("nothing.so"), "nothing.so"));
    CHECK(contains(library.open(""), "no file is named"));
    CHECK(contains(library.open("libm.so.6"), "has no function robot_dynamics_control_model"));
    CHECK(!library.model().is_bound());
}

/// The models with sizes of the compiler are those of the table.
void models_for_programs()
{
    const std::array<double, 7> q{0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8};
    const std::array<double, 7> rest{};
    std::array<double, 7> gravity;
    panda::gravity(q, gravity);
    double efforts[7];
    panda_control_model()->inverse(q.data(), rest.data(), rest.data(), nullptr, nullptr, nullptr, efforts);
    for (std::size_t k = 0; k < panda::joint_count; ++k) {
        CHECK(near(efforts[k], gravity[k]));
    }
    CHECK(near(gravity[1], -16.66, 0.005) && panda::joints[1].name == "panda_joint2");
}

} // namespace

int main()
{
    models();
    joints();
    settings();
    payloads();
    names();
    libraries();
    models_for_programs();
    return report();
}
