"""Descriptions of articulated robots: trees, shapes, the world they are in, and their files (MJCF, URDF)."""
