"""Views of the inflatable robot: motions, pictures and charts, and measures of its recorded shape."""
