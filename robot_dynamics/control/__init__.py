"""Control of a robot by its dynamic model, without ROS: references, control laws, watchdog. Time is an argument."""
