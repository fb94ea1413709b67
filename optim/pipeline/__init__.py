"""From terrains to a package for the machine: shapes, gaits, changes of shape, tables, and when to do what."""
