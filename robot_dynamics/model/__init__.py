"""What a robot is: data, and the formats that it is read from and written to. No algorithm."""
