"""Settings that all tests share."""

from hypothesis import settings

# The same examples in every run, and no deadline: shared machines pause.
settings.register_profile("lab", derandomize=True, deadline=None)
settings.load_profile("lab")
