"""Pictures, films and interactive pages of robots in motion, of any kind.

``motion`` describes anything that moves; ``voxel_motion`` and ``rigid_motion`` build motions from recorded frames.
``still`` draws single frames, ``film`` strips and films, ``picture`` a strip above a chart of channels; ``player``
plays motions in browsers; ``glb``, ``paraview`` and ``rerun_file`` write them for other programs. ``drawing`` draws
on any matplotlib axes. Names and colours of the parts of one kind of robot are in the package of that kind.
"""
