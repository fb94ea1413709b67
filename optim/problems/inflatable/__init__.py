"""Designing the inflatable robot: its shape, its heading and its gait."""
