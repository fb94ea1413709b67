"""The command line with a tiny pipeline and studies of seconds, for tests of what befalls them."""

import sys

import pytest
from small_pipeline import decided

from optim.cli import main
from optim.studies.beyond.body_and_learning.study import STUDY as LEARNING
from optim.studies.beyond.body_and_learning.study import BodyAndLearning
from optim.studies.beyond.forgetting.study import STUDY as FORGETTING
from optim.studies.beyond.forgetting.study import Effort, Forgetting

OUT, FEW = Effort(0), Effort(3, measured=3, controllers=32, starts=2, steps=10)
WALKERS = BodyAndLearning(bodies=2, controllers=4, repetitions=1, budget=4, cycles=1, nearer=0.001)


def shorten(replaced):
    """Let the pipeline and two studies of the budget ``small`` take small robots and little effort."""
    decided(replaced)
    replaced.setitem(LEARNING.scales, "small", WALKERS)
    replaced.setitem(FORGETTING.scales, "small", Forgetting(FEW, OUT, OUT))


if __name__ == "__main__":
    with pytest.MonkeyPatch.context() as replaced:
        shorten(replaced)
        code = main()
    sys.exit(code)
