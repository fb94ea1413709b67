"""Vehicles whose bodies evolve so that controllers are easily learned in them, judged by exact metrics."""
