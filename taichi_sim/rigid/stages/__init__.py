"""The stages of a rigid step, the laws that they apply, and their reverse pass."""
