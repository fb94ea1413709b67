"""What rovers offer to commands, searches, views and reports."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from robots.control.lights import LightAt, LightSeeker, approach, light_of
from robots.control.neural import Lights
from robots.robot import Facts, Measure, Outcome, Parameter, Trial, World
from robots.rover.body import LIGHTS, STEPS, Rover
from robots.rover.simulation import RoverResult, simulate
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.view.motion import Motion


@dataclass(frozen=True, eq=False)
class RoverRobot(LightSeeker):
    """A rover whose two weights are free.

    Attributes:
        body: the vehicle.
        looks: at the light in a trial.
    """

    body: Rover
    looks: int = STEPS

    kind = "rover"
    measures = (
        Measure("approach", "m", "approach to the light at the end"),
        Measure("best_approach", "m", "approach to the light when it was nearest"),
        Measure("reached", "", "lights reached"),
    )
    worlds = tuple(LightAt(*place) for place in LIGHTS)
    parameters = tuple(Parameter(name, -1.0, 1.0, step=0.05, start=1.0) for name in ("w1", "w2"))
    horizons = (5, 10, 20)

    def __post_init__(self) -> None:
        checks.whole_number("looks", self.looks, 2)

    @property
    def name(self) -> str:
        """Its name for people, with the number of its sensors in the published grid, if they have one."""
        number = self.body.vehicle.design
        return "rover" if number is None else f"rover {number}"

    def rollout(self, points: Floats, trial: Trial, lights: Lights) -> RoverResult:
        """Pairs of weights in the body."""
        every, gradients, compute = trial.record_every, bool(trial.gradients), trial.compute.options
        return simulate(self.body, points, lights, steps=self.looks, record_every=every, gradients=gradients, **compute)

    def judged(self, found: Any, light: LightAt) -> tuple[dict[str, Any], dict[str, Any]]:
        """How much nearer the light is at the end, with its gradient, and was at any time; whether it was reached."""
        ends, nearest = (approach(distance[:, 0], light) for distance in (found.distance, found.closest))
        slopes = {} if found.gradient is None else {"approach": -found.gradient[:, 0]}
        return {"approach": ends, "best_approach": nearest, "reached": found.success[:, 0].astype(float)}, slopes

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """The motion of the rover and its sensors."""
        from robots.rover.motion import rover_motion

        return rover_motion(self.body, outcome.result, [light_of(world).place], name=name)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values: body and length of a trial."""
        sensors = [x for site in self.body.sensors for x in site]
        return {**asdict(self.body), "sensors": sensors, "looks": self.looks}

    def facts(self) -> Facts:
        """Body and trial."""
        places = " and ".join(f"({x:g}, {y:g}) m" for x, y in self.body.sensors)
        return [
            ("Robot", f"{self.name}: {self.body.body_mass:g} kg, wheels of {100 * self.body.wheel_radius:.3g} cm"),
            ("Sensors", places),
            ("Trial", f"{self.lasts:g} s"),
        ]
