"""Pictures, films and interactive pages of robots in motion, of any kind.

``motion`` describes anything that moves; ``voxel_motion`` and ``rigid_motion`` make motions of what engines recorded.
``still`` draws their frames, ``film`` strips and films, ``picture`` a strip above their channels; ``player`` plays
them in browsers, ``glb``, ``paraview`` and ``rerun_file`` write them for other programs. ``drawing`` draws on any
matplotlib axes. What only one kind of robot has, such as names and colours of its parts, is in its own package.
"""
