"""Chapter 4 of the dissertation: training, co-optimisation, homeostasis, and the reality gap."""
