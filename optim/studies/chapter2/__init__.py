"""Chapter 2 of the dissertation: catastrophic interference in legged, wheeled and whegged quadrupeds."""
