"""The problems that ship with the lab, a module or folder for each kind of robot."""
