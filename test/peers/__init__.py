"""Independent references that the tests compare with, and robots to compare on."""
