"""Benchmarks: how fast the simulators are on this machine."""
