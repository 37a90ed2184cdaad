// Plays a script of events to the law: one command a line from the standard input, efforts and their reasons to the
// standard output. Tests compare them with those of the Python controller. The argument is the model.

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "robot_dynamics_control/law.hpp"
#include "robot_dynamics_control/model_library.hpp"
#include "robot_dynamics_control/transit_times.hpp"

using namespace robot_dynamics_control;

namespace {

class Player {
public:
    explicit Player(const Model& model) : model_(model) {}

    /// Play a line; false where it is no command.
    bool play(std::istringstream& line)
    {
        std::string command;
        line >> command;
        if (command == "joints") {
            for (std::string name; line >> name;) {
                joints_.push_back(name);
            }
            return true;
        }
        if (command == "mode" || command == "without_reference" || command == "friction_velocity") {
            return set_choice(command, line);
        }
        const std::vector<double> numbers = read_numbers(line);
        return set_numbers(command, numbers) || write_state(command, numbers) || act(command, numbers);
    }

private:
    static std::vector<double> read_numbers(std::istringstream& line)
    {
        std::vector<double> numbers;
        for (std::string word; line >> word;) {
            numbers.push_back(std::strtod(word.c_str(), nullptr)); // reads nan, inf and the smallest numbers
        }
        return numbers;
    }

    bool set_choice(const std::string& name, std::istringstream& line)
    {
        std::string choice;
        line >> choice;
        if (name == "mode") {
            return parse(choice, settings_.mode);
        }
        return name == "without_reference" ? parse(choice, settings_.without_reference)
                                           : parse(choice, settings_.friction_velocity);
    }

    bool set_numbers(const std::string& name, const std::vector<double>& numbers)
    {
        for (const auto& [key, values] : {std::pair{"kp", &settings_.kp}, std::pair{"kd", &settings_.kd},
                 std::pair{"limits", &settings_.limits}}) {
            if (name == key) {
                *values = numbers;
                return true;
            }
        }
        for (const auto& [key, value] :
            {std::pair{"state_timeout", &settings_.state_timeout},
                std::pair{"reference_timeout", &settings_.reference_timeout},
                std::pair{"ramp_time", &settings_.ramp_time}, std::pair{"deadline", &settings_.deadline}}) {
            if (name == key) {
                *value = numbers.at(0);
                return true;
            }
        }
        if (name == "deadline_misses") {
            settings_.deadline_misses = static_cast<int>(numbers.at(0));
            return true;
        }
        return false;
    }

    bool write_state(const std::string& name, const std::vector<double>& numbers)
    {
        ControlLaw& law = law_.control_law();
        for (const auto& [key, values] : {std::pair{"q", law.q()}, std::pair{"qd", law.qd()},
                 std::pair{"dependent", law.dependent_positions()}, std::pair{"twist", law.twist()},
                 std::pair{"gravity", law.gravity()}}) {
            if (name == key) {
                for (std::size_t i = 0; i < values.size(); ++i) {
                    values[i] = numbers.at(i);
                }
                return true;
            }
        }
        return false;
    }

    bool act(const std::string& name, const std::vector<double>& numbers)
    {
        if (name == "configure") {
            const std::string error = law_.configure(model_, joints_, settings_);
            std::printf("configured %s\n", error.c_str());
        } else if (name == "apply") {
            std::printf("applied %d\n", law_.apply(Law::complete(settings_, law_.control_law())));
        } else if (name == "payload") {
            std::printf("payload %d\n", law_.set_payload(numbers));
        } else if (name == "restart") {
            law_.restart();
        } else if (name == "end_reference") {
            law_.end_reference();
        } else if (name == "block") {
            law_.watchdog().block(numbers.at(0) != 0.0);
        } else if (name == "latency") {
            law_.watchdog().record_latency(numbers.at(0));
        } else if (name == "point") {
            track_point(numbers);
        } else if (name == "step") {
            print(law_.step(numbers.at(0), numbers.at(1), numbers.at(2)));
        } else if (name == "reject") {
            print(law_.reject_state(numbers.at(0), "a test rejects it"));
        } else if (name == "overdue") {
            print(law_.handle_overdue_efforts(numbers.at(0)));
        } else if (name == "halt") {
            print(law_.halt("a test halts it"));
        } else if (name == "tick") {
            print(law_.tick(numbers.at(0)));
        } else if (name == "transit") {
            const double delay = transit_.delay(static_cast<std::int64_t>(numbers.at(0)),
                static_cast<std::int64_t>(numbers.at(1)));
            std::printf("%.17g\n", delay);
        } else {
            return false;
        }
        return true;
    }

    void track_point(const std::vector<double>& numbers)
    {
        const std::size_t size = law_.size();
        const double* values = numbers.data() + 2;
        const Motion point{{values, size}, {values + size, size}, {values + 2 * size, size}};
        std::printf("point %d\n", static_cast<int>(law_.track_point(numbers.at(0), numbers.at(1), point)));
    }

    /// Efforts, activity, fault and reason, separated by tabs.
    void print(Numbers efforts) const
    {
        for (const double effort : efforts) {
            std::printf("%.17g ", effort);
        }
        std::printf("\t%s\t%s\t%d\t", to_string(law_.activity()), law_.describe_fault().c_str(),
            static_cast<int>(law_.no_reference()));
        for (std::size_t i = 0; i < law_.size(); ++i) {
            std::printf("%d", law_.is_saturated(i));
        }
        std::printf("\t%lu\n", law_.watchdog().stall_count());
    }

    Model model_;
    std::vector<std::string> joints_;
    Settings settings_;
    Law law_;
    TransitTimes transit_;
};

} // namespace

int main(int count, char** arguments)
{
    if (count != 2) {
        std::fprintf(stderr, "usage: player MODEL.so < SCRIPT\n");
        return 2;
    }
    ModelLibrary library;
    const std::string error = library.open(arguments[1]);
    if (!error.empty()) {
        std::fprintf(stderr, "%s\n", error.c_str());
        return 1;
    }
    Player player(library.model());
    int number = 0;
    for (std::string text; std::getline(std::cin, text);) {
        ++number;
        std::istringstream line(text);
        if (!player.play(line)) {
            std::fprintf(stderr, "line %d is no command: %s\n", number, text.c_str());
            return 1;
        }
    }
    return 0;
}
