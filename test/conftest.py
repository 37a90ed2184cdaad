"""Settings of all tests."""

from hypothesis import settings

# how long an example takes is the machine's matter: a busy one is no failure
settings.register_profile("robot_dynamics", deadline=None)
settings.load_profile("robot_dynamics")
