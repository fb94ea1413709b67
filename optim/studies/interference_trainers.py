"""Ways to train controllers in the study of interference."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from optim.studies.interference_climbers import Climbers, HillClimbers
from optim.studies.interference_gradient import GradientClimbers
from optim.studies.interference_settings import TRAINER_NAMES, Interference, Treatment

TRAINERS: Mapping[str, Callable[[Treatment, int, Interference, int | None], Climbers]] = MappingProxyType(
    dict(zip(TRAINER_NAMES, (HillClimbers, GradientClimbers), strict=True))
)
