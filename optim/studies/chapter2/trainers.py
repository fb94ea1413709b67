"""Ways to train controllers in the study of interference."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from optim.studies.chapter2.climbers import Climbers, HillClimbers
from optim.studies.chapter2.gradient import GradientClimbers
from optim.studies.chapter2.settings import TRAINER_NAMES, Interference, Treatment

TRAINERS: Mapping[str, Callable[[Treatment, int, Interference, int | None], Climbers]] = MappingProxyType(
    dict(zip(TRAINER_NAMES, (HillClimbers, GradientClimbers), strict=True))
)
