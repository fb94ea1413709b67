"""Studies: the dissertation's experiments, and one step beyond."""
