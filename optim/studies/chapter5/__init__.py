"""Chapter 5 of the dissertation: the robot that changes its shape, its searches, its gaits by hand, what they bear.

Source: Powers 2021 dissertation, ch. 5; Shah, Powers et al., Nature Machine Intelligence 3, 51-59, 2021.
"""
