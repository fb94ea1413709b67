"""Names of files of lattice robots, without what reads them."""

ROBOT_FORMAT = "morpholab-lattice-robot-1"
WALKER_FORMAT = "morpholab-walker-design-1"
VOXEL_SUFFIXES = (".vxl.json", ".vxa", ".vxc", ".vxd")
MESH_SUFFIXES = (".stl", ".obj", ".ply")
