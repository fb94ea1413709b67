"""The hunt for gaits that climb: searches beside each other at equal cost."""
