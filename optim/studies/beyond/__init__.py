"""Studies beyond the dissertation."""
