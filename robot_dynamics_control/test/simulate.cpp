// Simulates robots for one step: q, qd and efforts from the standard input, q and qd after it to the standard output.
// Arguments: the model, and the duration of the step [s].

#include <cstdio>
#include <cstdlib>
#include <string>

#include "robot_dynamics_control/model_library.hpp"
#include "rigid_body_simulation.hpp"

using namespace robot_dynamics_control;

namespace {

bool read(MutableNumbers values)
{
    for (double& value : values) {
        if (std::scanf("%lf", &value) != 1) {
            return false;
        }
    }
    return true;
}

void print(Numbers values)
{
    for (const double value : values) {
        std::printf("%.17g ", value);
    }
}

} // namespace

int main(int argc, char** argv)
{
    ModelLibrary library;
    RigidBodySimulation simulation;
    std::string error = argc == 3 ? library.open(argv[1]) : "usage: simulate MODEL DURATION";
    error = error.empty() ? simulation.configure(library.model()) : error;
    if (!error.empty()) {
        std::fprintf(stderr, "%s\n", error.c_str());
        return 1;
    }
    std::vector<double> efforts(library.model().joint_count());
    MutableNumbers q = simulation.q();
    MutableNumbers qd = simulation.qd();
    while (read(q) && read(qd) && read(efforts)) {
        if (!simulation.step(std::atof(argv[2]), efforts)) {
            std::fprintf(stderr, "the mass matrix is not positive definite\n");
            return 1;
        }
        print(q);
        print(qd);
        std::printf("\n");
    }
    return 0;
}
