"""Control of a robot by its dynamics, without ROS: references, the law, the watchdog. Time comes in as a number."""
