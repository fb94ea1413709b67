"""A machine that notices by its senses that the ground has changed, and changes its gait."""
