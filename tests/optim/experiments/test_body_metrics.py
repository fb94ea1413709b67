"""What was measured of a body, as people read it."""

import numpy as np

from optim.experiments.body_metrics import BodyMetrics
from optim.measures.catastrophic_interference import RunMeasures, SeveralRuns
from optim.measures.sampled import sampled_metrics


def test_the_text_of_metrics_is_short():
    """It printed a row for each controller."""
    succeeded = np.random.default_rng(0).random((1000, 9)) < 0.9
    runs = SeveralRuns.of([RunMeasures(n, 0.1 * n, 40.0, 0.3, 0.5, 7) for n in range(1, 7)])
    told = repr(BodyMetrics(succeeded, sampled_metrics(succeeded), runs))
    assert told.startswith(
        "BodyMetrics(succeeded=<bool of shape (1000, 9)>, sampled=SampledMetrics(learnability=Share("
    )
    assert "each=<9 of Share>" in told and "runs=<6 of RunMeasures>" in told
    assert len(told) < 800 and "\n" not in told
