"""What vehicles are asked to do, and a batch of them in the arrays that kernels take."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Floats

Wiring = tuple[tuple[int, ...], tuple[int, ...]]

MOST_STEPS = 10_000_000  # f32 counts them exactly
MOST_ROLLOUTS = 2**31 - 1


@dataclass(frozen=True, eq=False)
class VehicleTask:
    """Environments, and how long a vehicle has to reach the light of each.

    Attributes:
        starts: pose (x, y, heading) at which an environment begins [m, m, rad], shape (E, 3).
        lights: where its light is [m], shape (E, 2) or (2,); the origin by default.
        radius: a vehicle succeeds when its centre comes closer than this to the light, the start included [m].
        time_step: of Euler's method [s].
        steps: how many.

    Raises:
        ValueError: for shapes, radii, steps and starts that are not allowed.
    """

    starts: Floats
    lights: Floats = (0.0, 0.0)  # type: ignore[assignment]
    radius: float = 0.075
    time_step: float = 0.05
    steps: int = 10_000

    def __post_init__(self) -> None:
        starts = _finite("starts", self.starts)
        if starts.ndim != 2 or starts.shape[1] != 3 or not len(starts):
            raise ValueError(f"starts: an array of shape {starts.shape} is not allowed; give (E, 3): x, y, heading")
        lights = _finite("lights", self.lights)
        if lights.shape not in ((2,), (len(starts), 2)):
            raise ValueError(f"lights: an array of shape {lights.shape} is not allowed; give (2,) or {len(starts), 2}")
        for name in ("radius", "time_step"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float | np.floating) or not 0 < value < np.inf:
                raise ValueError(f"{name}: {value!r} is not allowed; give a finite number above 0")
        whole = isinstance(self.steps, int | np.integer) and not isinstance(self.steps, bool)
        if not whole or not 1 <= self.steps <= MOST_STEPS:
            raise ValueError(f"steps: {self.steps!r} is not allowed; give a whole number from 1 to {MOST_STEPS}")
        object.__setattr__(self, "steps", int(self.steps))
        object.__setattr__(self, "starts", starts)
        object.__setattr__(self, "lights", np.broadcast_to(lights, (len(starts), 2)).copy())
        near = np.flatnonzero(np.hypot(*self._relative.T) < self.radius)
        if near.size:
            place = starts[near[0], :2].tolist()
            raise ValueError(
                f"starts: {place} is not allowed; it is closer to the light than the radius, {self.radius:g}"
            )

    @property
    def _relative(self) -> Floats:
        return self.starts[:, :2] - self.lights

    @cached_property
    def seen(self) -> Floats:
        """Places of the vehicles relative to the lights, in their own frames, at the start, shape (E, 2)."""
        (x, y), heading = self._relative.T, self.starts[:, 2]
        cosine, sine = np.cos(heading), np.sin(heading)
        return np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=1)


@dataclass(frozen=True, eq=False)
class VehicleBatch:
    """Bodies and their controllers.

    Attributes:
        sites: places of the sensors in the frame of the body [m], shape (B, S, 2).
        controllers: W of m = W s [m^3/s]: a row for each motor (the first turns the vehicle to the left), shape
            (B, C, 2, S), or (1, C, 2, S) where all bodies have the same.

    Raises:
        ValueError: for other shapes and for numbers that are not finite.
    """

    sites: Floats
    controllers: Floats

    def __post_init__(self) -> None:
        sites = _finite("sites", self.sites)
        if sites.ndim != 3 or sites.shape[2] != 2 or 0 in sites.shape:
            raise ValueError(f"sites: an array of shape {sites.shape} is not allowed; give (B, S, 2), none of them 0")
        controllers = _finite("controllers", self.controllers)
        bodies, sensors = sites.shape[:2]
        fits = controllers.ndim == 4 and controllers.shape[0] in (1, bodies) and controllers.shape[2:] == (2, sensors)
        if not fits or 0 in controllers.shape:
            allowed = f"give ({'1' if bodies == 1 else f'{bodies} or 1'}, C, 2, {sensors})"
            raise ValueError(f"controllers: an array of shape {controllers.shape} is not allowed; {allowed}")
        object.__setattr__(self, "sites", sites)
        object.__setattr__(self, "controllers", controllers)

    @property
    def bodies(self) -> int:
        """Number of bodies, B."""
        return len(self.sites)

    @property
    def sensors(self) -> int:
        """Number of sensors of each body, S."""
        return self.sites.shape[1]

    @property
    def controllers_each(self) -> int:
        """Number of controllers of each body, C."""
        return self.controllers.shape[1]

    @property
    def shared(self) -> bool:
        """Whether all bodies have the same controllers."""
        return len(self.controllers) == 1

    @cached_property
    def wiring(self) -> Wiring:
        """The sensors that any controller connects to each motor."""
        used = np.abs(self.controllers).max(axis=(0, 1)) > 0
        return tuple(int(j) for j in np.flatnonzero(used[0])), tuple(int(j) for j in np.flatnonzero(used[1]))

    @cached_property
    def weights(self) -> Floats:
        """Connections by controller, in the order of the wiring, shape (B * C or C, connections or 1)."""
        columns = [self.controllers[:, :, motor, list(sensors)] for motor, sensors in enumerate(self.wiring)]
        rows = np.concatenate(columns, axis=-1)
        return rows.reshape(-1, rows.shape[-1]) if rows.shape[-1] else np.zeros((rows.shape[0] * rows.shape[1], 1))

    @cached_property
    def speed_bounds(self) -> Floats:
        """Sum of |W| / 2 of every controller: at distance d from all sensors the speed is at most this / d^2."""
        return 0.5 * np.abs(self.controllers).sum(axis=(2, 3)).reshape(-1)

    @cached_property
    def reach(self) -> Floats:
        """Distance of the outermost sensor from the centre [m], shape (B,)."""
        return np.hypot(self.sites[..., 0], self.sites[..., 1]).max(axis=1)


def _finite(name: str, values: ArrayLike) -> Floats:
    try:
        array = np.array(values, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: these are not allowed; give an array of numbers") from None
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: {array[~np.isfinite(array)][0]} is not allowed; give finite numbers")
    return array
