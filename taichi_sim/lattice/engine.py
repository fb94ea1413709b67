"""The lattice engine: a batch of robots of one topology, advanced by programs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np

from taichi_sim import runtime
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.base.short_text import ShortText
from taichi_sim.ground.relief import GroundTables, Relief, ground_tables
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.drivers.driver import Driver, Run
from taichi_sim.lattice.drivers.packed import PackedDriver
from taichi_sim.lattice.drivers.stepped import SteppedDriver
from taichi_sim.lattice.feedback import Course, Feedback, check_feedback
from taichi_sim.lattice.laws import link as beams
from taichi_sim.lattice.program import LatticeProgram
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.tables import PackedProgram, build_tables, pack_program

if TYPE_CHECKING:
    from taichi_sim.lattice.gradient import Tape

DRIVERS = ("auto", "packed", "stepped")


@dataclass(frozen=True, eq=False, repr=False)
class LatticeState(ShortText):
    """State of the voxels of B robots: poses and velocities in the world frame, in the body's voxel order.

    Attributes:
        positions: voxel centres [m], shape (B, V, 3).
        orientations: unit quaternions (w, x, y, z), shape (B, V, 4).
        velocities: velocities of the centres [m/s], shape (B, V, 3).
        angular_velocities: angular velocities [rad/s], shape (B, V, 3).
    """

    positions: np.ndarray
    orientations: np.ndarray
    velocities: np.ndarray
    angular_velocities: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class LatticeResult(ShortText):
    """Result of running a program: status of the robots, and their recorded poses.

    Attributes:
        status: "ok" or "diverged", shape (B,).
        steps: steps done; for a diverged robot the step in which it diverged, shape (B,).
        positions: recorded voxel centres [m], shape (B, S, V, 3); NaN where a robot never got there.
        orientations: recorded quaternions (w, x, y, z), shape (B, S, V, 4).
        strains: recorded strain of every link, shape (B, S, L).
        sizes: recorded rest size of every voxel along its own axes [m], shape (B, S, V, 3): what the program and the
            temperature made of it in the last step, or at step 0 what the first step begins with.
    """

    status: np.ndarray
    steps: np.ndarray
    positions: np.ndarray
    orientations: np.ndarray
    strains: np.ndarray
    sizes: np.ndarray


@dataclass(frozen=True, eq=False)
class SavedLattice:
    """All that an engine's robots are at one time; for :meth:`LatticeEngine.restore`."""

    driver: tuple[np.ndarray, ...]
    diverged: np.ndarray
    initial_channels: np.ndarray


class LatticeEngine:
    """Simulator of a batch of soft robots that share voxels, links and regions and may differ in all else.

    The numbers of a robot do not depend on the size of the batch, on its place or neighbours in it, or on the number
    of threads; in f64 on a CPU they are the same bits. A robot that diverges is reported and does not disturb others.

    Example:
        >>> rubber = Material(youngs_modulus=1e6, density=1e3)
        >>> bar = LatticeBody(voxels=[(x, 0, 0) for x in range(5)], materials=(rubber,), material_index=[0] * 5,
        ...                   voxel_size=0.01)
        >>> engine = LatticeEngine(bar, batch=2, gravity=9.80665, floor=True)
        >>> engine.run(ProgramBuilder(robot_count=2).build(lengths=1000)).status.tolist()
        ['ok', 'ok']
    """

    @runtime.exclusive
    def __init__(
        self,
        body: LatticeBody | Sequence[LatticeBody],
        batch: int | None = None,
        *,
        time_step: float | None = None,
        substeps: int = 1,
        floor: bool | Relief | Sequence[Relief] = False,
        self_contact: bool | Literal["published"] = True,
        fluid: bool = False,
        gravity: float = 0.0,
        driver: str = "auto",
        compute: Compute | None = None,
        **options: Unpack[ComputeOptions],
    ) -> None:
        """Set the robots up at rest at their start positions.

        Args:
            body: one body for all robots, or one per robot; they may differ in the values of their materials only.
            batch: number of robots B.
            time_step: dt [s]; by default the least ``stable_time_step`` of the bodies, in water or with balanced links
                for the sizes that their materials have: give a shorter one to programs that let voxels swell then.
            substeps: into how many parts each time step is divided, where programs are written in steps that are too
                long to be stable. Programs and results count whole time steps; decisions of a feedback need 1.
            floor: whether there is a floor at z = -h/2; or what rises over it, for all robots or one each.
            self_contact: whether voxels of a robot collide with each other; ``"published"``: as in the simulator of
                the dissertation, which misses some collisions of voxels of more than 1.2 edges.
            fluid: whether a fluid at rest resists all outer faces, as much as ``Quantity.RESISTANCE`` says. Pressure
                then acts on the closed surface that the voxels with pressurised faces must form, see
                ``laws.enclosure``, and links keep momentum and angular momentum, see ``laws.link.balanced``. On a body
                with several chambers pressure always acts so.
            gravity: uniform acceleration along -z [m/s^2].
            driver: "packed" (CPU: the voxels of a robot in vector lanes), "stepped" (a thread per link or voxel) or
                "auto" (packed on a CPU, else stepped). Runs do not depend on it; the last bits of gradients do.
            compute: device, precision (f64 by default) and threads.
            **options: instead of ``compute``, its fields one by one.

        Raises:
            ValueError: if an argument is not allowed; names it, the value and what is allowed.
        """
        bodies = [body] if isinstance(body, LatticeBody) else list(body)
        batch = len(bodies) if batch is None else batch
        if not isinstance(batch, int | np.integer) or batch < 1:
            raise ValueError(f"batch: {batch!r} is not allowed; give a whole number of at least 1")
        bodies = bodies * batch if len(bodies) == 1 else bodies
        self._check_bodies(bodies, int(batch))
        self.body, self.batch, self.bodies = bodies[0], int(batch), tuple(bodies)
        ground = self._ground(floor, bool(fluid))
        if time_step is None:
            is_afloat = bool(fluid) or (ground is not None and ground.water)
            time_step = min(b.stable_time_step(is_afloat) for b in {id(b): b for b in bodies}.values())
        if compute is not None and options:
            raise ValueError(f"compute: give it or {', '.join(options)}, not both")
        self.compute = compute or Compute.given(options)
        _check_settings(time_step, gravity, self_contact, driver, self.compute.device)
        self.time_step, self.gravity = float(time_step), float(gravity)
        self.substeps = whole_number("substeps", substeps, 1)
        precision, on_cpu = self.compute.precision, self.compute.device == "cpu"
        runtime.start(self.compute)
        self.order = self.body.topology.order
        self.place = np.argsort(self.order)  # of each of the body's voxels in the engine's order
        self.tables = build_tables(bodies, self.time_step / self.substeps, bool(fluid), ground)
        switches = (ground is not None or bool(floor), bool(self_contact))
        self._driver: Driver
        if driver == "stepped" or not on_cpu:
            self._driver = SteppedDriver(self.tables, self.batch, precision, switches, on_cpu)
        else:
            self._driver = PackedDriver(self.tables, self.batch, precision, switches, self.body.voxels[self.order])
        self._driver.lists_grow = self_contact != "published"
        self._diverged = np.zeros(self.batch, bool)
        self._chosen = {"floor": floor, "self_contact": self_contact, "fluid": fluid, "driver": driver}
        self.reset()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle the engine as what makes it again, and where it is; copies go on with the same bits."""
        made = {"body": self.bodies, "time_step": self.time_step, "gravity": self.gravity, "compute": self.compute}
        made["substeps"] = self.substeps
        return _made_again, ({**made, **self._chosen}, self._driver.radius, self.save())

    def _ground(self, floor: bool | Relief | Sequence[Relief], fluid: bool) -> GroundTables | None:
        """Tables of uneven ground, if it is given."""
        if isinstance(floor, bool | np.bool_):
            return None
        reliefs = [floor] * self.batch if isinstance(floor, Relief) else list(floor)
        if len(reliefs) != self.batch:
            raise ValueError(f"floor: {len(reliefs)} reliefs for a batch of {self.batch}; give one, or one per robot")
        if fluid:
            raise ValueError("floor: uneven ground is not allowed in a fluid; leave one of them out")
        return ground_tables("floor", reliefs)

    @staticmethod
    def _check_bodies(bodies: list[LatticeBody], batch: int) -> None:
        if len(bodies) != batch:
            raise ValueError(f"body: {len(bodies)} bodies for a batch of {batch}; give one, or one per robot")
        first, shared = bodies[0], [f.name for f in fields(LatticeBody) if f.name != "materials"]
        for other in {id(b): b for b in bodies}.values():
            same = all(np.array_equal(getattr(first, name), getattr(other, name)) for name in shared)
            if not same or len(other.materials) != len(first.materials):
                raise ValueError("body: bodies of one batch may differ in the values of their materials only")

    @property
    def inverse_masses(self) -> np.ndarray:
        """Inverse mass and inertia of every voxel in the engine's order, shape (B, V, 2)."""
        inverse: np.ndarray = self.tables.constant[:, self.tables.group, :2]
        return inverse

    @property
    def bytes_per_robot(self) -> int:
        """Memory of the batch per robot [B], without recordings."""
        return self._driver.bytes_per_robot

    def reset(self) -> None:
        """Put every robot at rest at its start, and set its channels to the values of the materials."""
        self._driver.write(memory.CHANNEL, self.tables.channel)
        # Which still hold what the materials say: those that no event has set, shape (B, 25 G).
        self.initial_channels = np.ones(self.tables.channel.shape[:2], bool)
        self.set_positions(np.broadcast_to(self.body.start_positions, (self.batch, self.body.voxel_count, 3)))

    def set_positions(self, positions: np.ndarray) -> None:
        """Put every robot at rest, upright, at these voxel centres [m], shape (B, V, 3); links forget their past."""
        still = np.zeros((self.batch, self.body.voxel_count, 3))
        upright = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (self.batch, self.body.voxel_count, 4))
        self.set_state(LatticeState(positions, upright, still, still))

    def set_state(self, state: LatticeState) -> None:
        """Set the state of every robot; links forget their past, but channels keep their values.

        Voxels on a floor slide if they move sideways, else they stick.
        Fixed voxels are held where the body says, whatever their start.

        Raises:
            ValueError: for wrong shapes, or quaternions whose length is not one to six digits.
        """
        voxel = np.zeros((self.batch, self.body.voxel_count, memory.VOXEL_WIDTH))
        for name, part in memory.MOTION.items():
            given, shape = np.asarray(getattr(state, name), float), voxel[:, :, part].shape
            if given.shape != shape or not np.isfinite(given).all():
                raise ValueError(f"{name}: give finite numbers of shape {shape}")
            voxel[:, :, part] = given[:, self.order]
        if np.abs((voxel[:, :, memory.MOTION["orientations"]] ** 2).sum(axis=2) - 1).max() > 2e-6:
            raise ValueError("orientations: give unit quaternions (w, x, y, z)")
        voxel[:, :, memory.MOTION["velocities"]] /= self.inverse_masses[..., :1]
        voxel[:, :, memory.MOTION["angular_velocities"]] /= self.inverse_masses[..., 1:]
        # Voxels at rest, or that move up or down only, start in the static state; others slide if they touch a floor.
        level = voxel[:, :, memory.MOTION["velocities"]][:, :, :2]
        voxel[:, :, memory.STICKS] = (level == 0).all(axis=2)
        self._driver.write(memory.VOXEL, voxel)
        link = np.zeros((self.batch, len(self.tables.link_ends), memory.LINK_WIDTH))
        link[:, :, memory.REGIME] = beams.NEW
        self._driver.write(memory.LINK, link)
        self._driver.write(memory.STRAIN, np.zeros((self.batch, self.tables.gauges, memory.STRAIN_WIDTH)))
        self._driver.write(memory.PRINT, np.zeros((self.batch, self.tables.prints, memory.PRINT_WIDTH)))
        self._driver.forget_neighbours(self._driver.memory)
        self._diverged[:] = False

    def save(self) -> SavedLattice:
        """Copy everything that changes: motion, memories of links and contacts, and channels."""
        return SavedLattice(self._driver.save(), self._diverged.copy(), self.initial_channels.copy())

    def restore(self, saved: SavedLattice) -> None:
        """Go back to what :meth:`save` returned; runs from there give the same bits as before."""
        self._driver.restore(saved.driver)
        self._diverged[:], self.initial_channels[:] = saved.diverged, saved.initial_channels

    @runtime.exclusive
    def run(
        self,
        program: LatticeProgram,
        progress: Callable[[float], None] | None = None,
        feedback: Feedback | None = None,
    ) -> LatticeResult:
        """Run a program: advance every robot by its own number of time steps, from its present state.

        Args:
            program: events over time, with steps counted from now.
            progress: called now and then with the fraction done, 0 to 1.
            feedback: decides the values of some of the program's events on the way.

        Raises:
            ValueError: if the program is for another number of robots or names unknown regions, or for decisions that
                it has no room for.
        """
        program = self.in_substeps(program, feedback)
        run = self.begin(program)
        self.course(run, program, feedback).advance(tick=progress)
        return self.finish(run)

    @runtime.exclusive
    def record(
        self,
        program: LatticeProgram,
        memory: float = 1e9,
        progress: Callable[[float], None] | None = None,
        feedback: Feedback | None = None,
    ) -> "Tape":
        """Run a program like :meth:`run`, and keep what is needed to differentiate what it did.

        Args:
            program: what happens, steps counted from now.
            memory: bound [B] on what is kept now and while pulling back; the less, the more is computed again.
            progress: called now and then with the fraction done, 0 to 1.
            feedback: decides the values of some of the program's events on the way, and takes derivatives back.

        Raises:
            ValueError: as :meth:`run`; or if the memory is too small.
        """
        from taichi_sim.lattice.gradient import Tape

        return Tape(self, self.in_substeps(program, feedback), memory, progress, feedback)

    def in_substeps(self, program: LatticeProgram, feedback: Feedback | None) -> LatticeProgram:
        """Divide the steps of a program into the engine's substeps; a feedback is refused if there are several."""
        if feedback is not None and self.substeps > 1:
            allowed = "give 1 and a shorter time_step"
            raise ValueError(f"substeps: {self.substeps} is not allowed with a feedback; {allowed}")
        return program.refined(self.substeps)

    def course(self, run: Run, program: LatticeProgram, feedback: Feedback | None) -> Course:
        """Combine a run that has begun with the decisions of a feedback."""
        if feedback is not None:
            check_feedback(feedback, program)
        return Course(run, feedback, self.place, len(self.body.topology.links))

    @runtime.exclusive
    def begin(self, program: LatticeProgram) -> Run:
        """Start a program that :meth:`in_substeps` returned at its step 0; for :meth:`run` and for gradients."""
        if program.robot_count != self.batch:
            raise ValueError(f"program: made for {program.robot_count} robots, the engine has {self.batch}")
        packed = pack_program(program, self.tables.group_region)
        runtime.start(self.compute)
        step = self.time_step / self.substeps
        return self._driver.begin(packed, ~self._diverged, step, self.body.voxel_size, self.gravity)

    @runtime.exclusive
    def finish(self, run: Run) -> LatticeResult:
        """Return the result of a run, in the body's voxel order."""
        steps, diverged, (poses, strains, sizes) = run.finish()
        self._note_events(run.program, steps)
        # A state that is not finite is no result, whatever the strains said.
        diverged = diverged | ~np.isfinite(self._driver.read(memory.VOXEL)).all(axis=(1, 2))
        self._diverged |= diverged
        poses = np.take(poses, self.place, axis=2)
        strains = strains[:, :, : len(self.body.topology.links)]
        sizes = np.take(sizes, self.tables.group[self.place], axis=2)
        lost = ~np.isfinite(poses).all(axis=(2, 3))
        for recorded in (poses, strains, sizes):
            recorded[lost] = np.nan
        status = np.where(self._diverged, "diverged", "ok")
        return LatticeResult(status, -(-steps // self.substeps), poses[..., :3], poses[..., 3:], strains, sizes)

    def _note_events(self, program: PackedProgram, steps: np.ndarray) -> None:
        """Remember which channels no longer hold what the materials say."""
        robot = np.repeat(np.arange(self.batch), np.diff(program.first))
        step, target = program.marks[: len(robot)].T
        set_now = (target >= 0) & (step <= steps[robot])
        self.initial_channels[robot[set_now], target[set_now]] = False

    def state(self) -> LatticeState:
        """Return poses and velocities of the voxels; NaN for robots that diverged."""
        voxel = np.take(self._driver.read(memory.VOXEL), self.place, axis=1).astype(float)
        voxel[self._diverged] = np.nan
        inverse = np.take(self.inverse_masses, self.place, axis=1)
        position, orientation, momentum, spin = (voxel[..., part] for part in memory.MOTION.values())
        return LatticeState(position, orientation, momentum * inverse[..., :1], spin * inverse[..., 1:])


def _check_settings(time_step: float, gravity: float, self_contact: object, driver: str, device: str) -> None:
    """Check the settings of an engine that do not depend on its bodies."""
    if not (math.isfinite(float(time_step)) and time_step > 0):
        raise ValueError(f"time_step: {time_step!r} is not allowed; it must be positive")
    if not math.isfinite(gravity):
        raise ValueError(f"gravity: {gravity!r} is not a finite number")
    if self_contact not in (True, False, "published"):
        raise ValueError(f"self_contact: {self_contact!r} is not allowed; give True, False or 'published'")
    if driver not in DRIVERS:
        raise ValueError(f"driver: {driver!r} is unknown; choose one of {', '.join(DRIVERS)}")
    if driver == "packed" and device != "cpu":
        raise ValueError(f"driver: {driver!r} runs on a cpu only, not on {device!r}; use 'auto'")


def _made_again(made: dict[str, Any], radius: float, saved: SavedLattice) -> LatticeEngine:
    """An engine made with the same arguments and put where the saved one was, with the same lists of neighbours."""
    engine = LatticeEngine(**made)
    engine._driver.radius = radius
    engine.restore(saved)
    return engine
