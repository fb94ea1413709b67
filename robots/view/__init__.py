"""Looking at robots: poses as numbers, poses and gaits as pictures.

``shape`` reads numbers off recorded poses, ``drawing`` draws on any matplotlib axes, ``picture`` writes files.
"""
