"""All ways in which a search writes a schedule, by the names that commands know."""

from optim.problems.inflatable.encoding import BitwiseGait, CodedGait, GaitEncoding, PatternGait
from optim.problems.inflatable.graded_encoding import GradedGait, GradedPatternGait, GradedWaveGait

# Encodings that can say a given gait, by their static method ``genome``.
SPEAKING: dict[str, type[BitwiseGait | GradedGait]] = {
    "bits": BitwiseGait,
    "graded": GradedGait,
    "graded-wave": GradedWaveGait,
}
ENCODINGS: dict[str, type[GaitEncoding]] = {
    "codes": CodedGait,
    "bits": BitwiseGait,
    "pattern": PatternGait,
    "graded": GradedGait,
    "graded-pattern": GradedPatternGait,
    "graded-wave": GradedWaveGait,
}
