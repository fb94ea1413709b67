"""``python -m optim`` is the command ``morpholab``."""

from optim.entry import start

raise SystemExit(start())
