"""Batched physics in Taichi: soft lattices of beams, vehicles and rigid bodies. Knows no robots."""
