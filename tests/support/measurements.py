"""Measurements of feet that are dragged, as files of ``morpholab calibrate`` have them."""

GRIPPING = """
geometry = "small"
[[drag]]
load_n = 0.5
displacement_mm = [2, 4, 6, 8]
force_n = [0.41, 0.39, 0.405, 0.4]
force_sd_n = 0.01
"""
SLIDING = """[[drag]]
foot = "slides"
load_n = 0.5
displacement_mm = [2, 4, 6, 8]
force_n = [0.101, 0.099, 0.1, 0.1]
force_sd_n = 0.002
"""
