"""What quadrupeds offer to commands, searches, views and reports."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from robots.control.lights import LightAt, LightSeeker, approach, light_of
from robots.control.neural import Lights, random_weights
from robots.quadruped.body import MOTORS, SENSORS, STEPS, TWO_ENVIRONMENTS, VARIANTS, Kind, Quadruped
from robots.quadruped.simulation import QuadrupedResult, simulate
from robots.robot import Facts, Measure, Outcome, Parameter, Trial, World
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.view.motion import Motion

FIRST = random_weights(1, SENSORS, MOTORS, np.random.default_rng(0))  # of a robot that nobody has trained


@dataclass(frozen=True, eq=False)
class QuadrupedRobot(LightSeeker):
    """A quadruped whose controller is free.

    Attributes:
        body: the robot.
        variant: a name of ``VARIANTS``.
        looks: at the sensors in a trial.
    """

    body: Quadruped
    variant: str = "as-run"
    looks: int = STEPS

    kind = "quadruped"
    measures = (Measure("light", "1/m²", "light at the end"), Measure("approach", "m", "approach to the light"))
    worlds = tuple(LightAt(*place) for place in TWO_ENVIRONMENTS)
    parameters = tuple(
        Parameter(f"w{s}_{m}", -1.0, 1.0, step=0.05, start=float(FIRST[0, s, m]))
        for s in range(SENSORS)
        for m in range(MOTORS)
    )
    horizons = (1, 2, 5)

    def __post_init__(self) -> None:
        checks.choice("variant", self.variant, tuple(VARIANTS))
        checks.whole_number("looks", self.looks, 2)

    @classmethod
    def of(cls, kind: Kind, body: Mapping[str, float], **settings: Any) -> Self:
        """A quadruped of numbers that describe its body."""
        return checks.built(cls, {"body": Quadruped(kind, **body), **settings})

    @property
    def name(self) -> str:
        """The kind of its body."""
        return f"{self.body.kind} quadruped"

    def rollout(self, points: Floats, trial: Trial, lights: Lights) -> QuadrupedResult:
        """Controllers in the body."""
        return simulate(
            self.body,
            points.reshape(-1, SENSORS, MOTORS),
            lights,
            variant=VARIANTS[self.variant],
            steps=self.looks,
            record_every=trial.record_every,
            gradients=bool(trial.gradients),
            **trial.compute.options,
        )

    def judged(self, found: Any, light: LightAt) -> tuple[dict[str, Any], dict[str, Any]]:
        """The light, with its gradient, and how much nearer it is."""
        slopes = {} if found.gradient is None else {"light": found.gradient.reshape(len(found.light), -1)}
        return {"light": found.light[:, 0], "approach": approach(found.distance[:, 0], light)}, slopes

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """The motion of the quadruped and its feet."""
        from robots.quadruped.motion import quadruped_motion

        return quadruped_motion(self.body, outcome.result, [light_of(world).place], name=name)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values: body, variant and length of a trial."""
        return {**asdict(self.body), "variant": self.variant, "looks": self.looks}

    def facts(self) -> Facts:
        """Body and trial."""
        body = self.body
        return [
            ("Robot", f"{self.name}: body of {100 * body.body_width:g} cm, limbs of {100 * body.limb_length:g} cm"),
            ("Driven", f"{MOTORS} motors by {SENSORS} sensors, {VARIANTS[self.variant].name}"),
            ("Trial", f"{self.lasts:g} s"),
        ]
