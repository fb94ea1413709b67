"""Exit codes of commands."""

FAILED = 1  # the work, not the input, was at fault
BAD_INPUT = 2
BUG = 70  # what nobody foresaw: EX_SOFTWARE of sysexits.h
HUNG_UP, INTERRUPTED, CLOSED_PIPE, TERMINATED = 129, 130, 141, 143  # as shells report the signals
STOPPED = (HUNG_UP, INTERRUPTED, TERMINATED)  # by a signal that ends a command in order
