"""``python -m morpholab`` is the command ``morpholab``."""

from optim.cli import main

raise SystemExit(main())
