"""What a robot is: data, readers and writers. No algorithm."""
