"""The recursions traced into straight-line programs: recorded once with symbols, counted, written out, compiled."""
