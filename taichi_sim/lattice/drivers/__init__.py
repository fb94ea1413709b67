"""How the stages of a step are run: robots in vector lanes, or a kernel per stage; forwards and back."""
