"""How the inflatable robot is shown: its motions, pictures and charts, and numbers read off its poses."""
