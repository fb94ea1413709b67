"""The study of gaits for a real floor: searched under draws of what is not known, judged under others."""
