"""Designing robots: problems, search methods and runs. Knows robots only through problems."""
