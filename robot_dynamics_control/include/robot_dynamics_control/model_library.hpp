// Models in shared objects: one program for every robot.

#ifndef ROBOT_DYNAMICS_CONTROL_MODEL_LIBRARY_HPP
#define ROBOT_DYNAMICS_CONTROL_MODEL_LIBRARY_HPP

#include <dlfcn.h>

#include <cstring>
#include <string>

#include "robot_dynamics_control/model.hpp"

namespace robot_dynamics_control {

/// A shared object with the model of a robot, as robot_dynamics_generate(... CONTROL SHARED) builds it.
///
/// It stays loaded as long as this object lives; the model must not be used afterwards. A shared object runs as code of
/// the program: load only files that no one else may write.
class ModelLibrary {
public:
    ModelLibrary() = default;
    ModelLibrary(const ModelLibrary&) = delete;
    ModelLibrary& operator=(const ModelLibrary&) = delete;
    ~ModelLibrary() { close(); }

    /// Load a shared object. Returns what is wrong, empty where the model can be used; not for the control loop.
    std::string open(const std::string& path)
    {
        close();
        if (path.empty()) { // dlopen would open the program itself
            return "the model cannot be loaded: no file is named";
        }
        handle_ = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
        if (handle_ == nullptr) {
            return "the model cannot be loaded: " + last_error(path);
        }
        void* symbol = dlsym(handle_, ROBOT_DYNAMICS_MODEL_SYMBOL);
        if (symbol == nullptr) {
            close();
            return path + " has no function " ROBOT_DYNAMICS_MODEL_SYMBOL
                          ": build it by robot_dynamics_generate(... CONTROL SHARED)";
        }
        robot_dynamics_model_function function = nullptr;
        std::memcpy(&function, &symbol, sizeof(function)); // C++ has no cast from a pointer to an object
        std::string error = model_.bind(function());
        if (!error.empty()) {
            close();
            return path + ": " + error;
        }
        return "";
    }

    /// The model; bound after `open` returned an empty text.
    const Model& model() const noexcept { return model_; }

    /// Unload the shared object.
    void close()
    {
        model_ = Model();
        if (handle_ != nullptr) {
            dlclose(handle_);
            handle_ = nullptr;
        }
    }

private:
    static std::string last_error(const std::string& path)
    {
        const char* message = dlerror();
        return message == nullptr ? path : message;
    }

    void* handle_ = nullptr;
    Model model_;
};

} // namespace robot_dynamics_control

#endif
