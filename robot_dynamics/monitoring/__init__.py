"""External torques, contact wrenches and collisions of a robot that moves, out of joint states and efforts."""
