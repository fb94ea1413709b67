"""Colours of the inflatable robot's parts."""

from robots.inflatable.body import BLADDER_COUNT
from robots.view.scene import HUES, PURPLES, SAND, STONE

SKIN, SEAM = SAND, STONE
FEET = PURPLES
# A bladder and its counterpart on the other side of the pouch have the same hue.
BLADDERS = tuple(HUES[min(i, BLADDER_COUNT - 1 - i)] for i in range(BLADDER_COUNT))
