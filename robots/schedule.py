"""Forwards to ``robots.inflatable.schedule``: the import path of version 1.0."""

from robots.inflatable.schedule import GaitSchedule

__all__ = ["GaitSchedule"]
