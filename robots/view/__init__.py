"""Pictures, films and interactive pages of robots in motion, and numbers that describe their poses.

``shape`` reads numbers off recorded poses, ``drawing`` draws on any matplotlib axes, ``picture`` writes files.
``motion`` describes anything that moves; ``rigid_motion`` makes motions of results. ``still`` draws their frames, ``film`` their strips and films; ``player`` plays them in browsers, ``glb``,
``paraview`` and ``rerun_file`` write them for other programs.
"""
