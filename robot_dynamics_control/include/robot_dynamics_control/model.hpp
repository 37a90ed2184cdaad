// The model of a robot that `robot-dynamics generate ROBOT --control` wrote, as a class of C++.

#ifndef ROBOT_DYNAMICS_CONTROL_MODEL_HPP
#define ROBOT_DYNAMICS_CONTROL_MODEL_HPP

#include <cstddef>
#include <string>
#include <string_view>

#include "robot_dynamics_control/array_view.hpp"
#include "robot_dynamics_control/model_abi.h"

namespace robot_dynamics_control {

/// A model; it owns nothing, so that copies are cheap. Joint vectors are in the order of `joint`.
///
/// The functions that compute allocate nothing, lock nothing and throw nothing. They may be called by several threads.
class Model {
public:
    Model() = default;

    /// Use a generated model. Returns what is wrong with it, empty where it can be used.
    std::string bind(const robot_dynamics_model* model)
    {
        if (model == nullptr) {
            return "there is no model: a null pointer was passed";
        }
        if (model->abi != ROBOT_DYNAMICS_MODEL_ABI || model->size < sizeof(robot_dynamics_model)) {
            return "the model has version " + std::to_string(model->abi) + " of the interface, this program needs "
                + std::to_string(ROBOT_DYNAMICS_MODEL_ABI) + ": generate and compile the model again";
        }
        model_ = model;
        return "";
    }

    bool is_bound() const noexcept { return model_ != nullptr; }

    /// The table itself.
    const robot_dynamics_model& table() const noexcept { return *model_; }

    std::string robot() const { return model_->robot; }

    /// Number of joints of the state, n.
    std::size_t joint_count() const noexcept { return model_->joint_count; }

    /// Number of positions that the models take: n, or all joints of a robot with loops.
    std::size_t position_count() const noexcept { return model_->position_count; }

    const robot_dynamics_joint& joint(std::size_t index) const noexcept { return model_->joints[index]; }

    bool has_loops() const noexcept { return model_->loops != nullptr; }
    bool has_springs() const noexcept { return model_->springs != nullptr; }
    bool has_moving_base() const noexcept { return model_->moving_base != 0; }
    bool has_payload() const noexcept { return model_->payload_size != 0; }

    /// Name of position `index` of the models.
    const char* position_name(std::size_t index) const noexcept
    {
        return has_loops() ? model_->loops->positions[index].name : model_->joints[index].name;
    }

    /// Number of joints that loops determine.
    std::size_t dependent_count() const noexcept { return has_loops() ? model_->loops->dependent_count : 0; }

    /// Name of a joint that loops determine.
    const char* dependent_name(std::size_t index) const noexcept
    {
        const robot_dynamics_loops& loops = *model_->loops;
        for (std::size_t position = 0; position < model_->position_count; ++position) {
            const robot_dynamics_position& row = loops.positions[position];
            // a mimic joint has the variable of the joint that it mimics, but not its multiplier and offset
            if (row.variable == loops.dependent[index] && row.multiplier == 1.0 && row.offset == 0.0) {
                return row.name;
            }
        }
        return "";
    }

    /// Index of a joint of the state; n where no joint has the name.
    std::size_t find_joint(std::string_view name) const noexcept
    {
        std::size_t index = 0;
        while (index < joint_count() && name != joint(index).name) {
            ++index;
        }
        return index;
    }

    /// Efforts (n) of a motion, without the friction that `friction` computes.
    ///
    /// q: position_count() numbers; qd, qdd: n. twist: 6 and gravity: 3 numbers in the frame of a moving base.
    /// payload: 10 numbers of a model that has_payload(). Pointers that are not needed may be null.
    void inverse(const double* q, const double* qd, const double* qdd, const double* twist, const double* gravity,
        const double* payload, double* efforts) const noexcept
    {
        model_->inverse(q, qd, qdd, twist, gravity, payload, efforts);
    }

    bool has_friction() const noexcept { return model_->friction != nullptr; }

    /// Friction (n) without that of loads. Call it only where has_friction().
    void friction(const double* q, const double* qd, double* efforts) const noexcept
    {
        model_->friction(q, qd, efforts);
    }

private:
    const robot_dynamics_model* model_ = nullptr;
};

} // namespace robot_dynamics_control

#endif
