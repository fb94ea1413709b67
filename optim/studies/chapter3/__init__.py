"""Chapter 3 of the dissertation: what the places of sensors do, in a model vehicle and in a simulated rover."""
