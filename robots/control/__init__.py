"""What drives robots: networks of neurons, patterns, cyclic programs."""
