"""How fast the simulators are on this machine."""
