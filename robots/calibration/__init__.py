"""Experiments on a rig and their simulation, so that properties of the robot can be fitted to what was measured."""
