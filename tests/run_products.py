"""What tests of runs read from a run folder."""

import json


def products(folder):
    """Contents of the files that must not depend on interruptions."""
    return {name: (folder / name).read_bytes() for name in ("log.jsonl", "best.json", "gait.csv", "config.toml")}


def log(folder):
    """Lines of the log."""
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
