"""Laws over reals, and reverse mode through them: tracing, lanes, elementary functions, rotations."""
