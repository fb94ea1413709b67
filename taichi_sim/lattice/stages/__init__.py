"""The stages of a lattice step and their adjoints: load reals, apply laws, store."""
