"""The rig's side of ``morpholab play``, in Python: read lines, set pressures, vent when told, or when nobody speaks.

Usage: python reader.py < stream.jsonl, or python reader.py /dev/ttyUSB1 on the computer beside the valves (set the
speed of the device before: stty -F /dev/ttyUSB1 115200 raw).
"""

import json
import os
import select
import signal
import sys

SILENCE = 2.0  # after which lines are vented [s]; heartbeats come every half second


def set_pressures(pressures, units):
    """Replace this by what sets your regulators."""
    print(f"{units} {' '.join(map(str, pressures))}\n", end="")  # at once: no interruption cuts a line


def vent(why):
    """Replace this by what opens all lines to the air."""
    print("vent:", why)


def read(descriptor, answer):
    """Follow a stream until it stops; vent, whatever ends it but SIGKILL: a fault of this program and signals, too."""
    why = "the reader failed"
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(1))  # through the vent below
    try:
        why = follow(descriptor, answer)
    except (KeyboardInterrupt, SystemExit):
        why = "interrupted"
        raise
    finally:
        vent(why)


def follow(descriptor, answer):
    """Set what a stream tells until it stops, is silent or makes no sense; returns why it ended."""
    rest, units, lines_of_rig, expected = b"", None, 0, 0
    while True:
        if not select.select([descriptor], [], [], SILENCE)[0]:
            return "silence"
        got = os.read(descriptor, 4096)
        if not got:
            return "closed"
        *lines, rest = (rest + got).split(b"\n")
        for line in lines:
            try:
                told = json.loads(line)
            except ValueError:
                continue  # a line that was cut, or noise
            if not isinstance(told, dict):
                continue  # noise that happens to be JSON, such as a digit
            if "stop" in told:
                return told["stop"]
            if "stream" in told:
                units, lines_of_rig, expected = told["units"], len(told["channels"]), 0
            if "n" in told:
                if units is None or told["n"] != expected:
                    return f"sample {expected} is missing"
                if len(told["p"]) != lines_of_rig:
                    return f"sample {expected} has other lines"
                set_pressures(told["p"], units)
                answer(f"ok {told['n']}\n".encode())
                expected += 1


if __name__ == "__main__":
    if len(sys.argv) > 1:
        port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
        read(port, lambda line: os.write(port, line))
    else:
        read(0, lambda line: None)
