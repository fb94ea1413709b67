"""Robot models: they turn designs into programs for the physics, and know no optimisers."""
