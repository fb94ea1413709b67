"""Whether metrics of a soft body tell how soon controllers are learned in it: walkers that feel, in four worlds."""
