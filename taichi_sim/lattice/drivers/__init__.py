"""How the stages of a step are run: robots in vector lanes, or a thread per link or voxel; forwards and back."""
