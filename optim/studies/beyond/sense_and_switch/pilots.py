"""Machines on a course: which gait each plays, told the ground, by its senses, by chance, or always the same one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optim.studies.beyond.sense_and_switch.machine import HERE, Grounds, machine
from robots.control.switching import Switcher, Switching, features, steady
from robots.course import Course
from robots.lattice_robot.episodes import Episodes
from robots.lattice_robot.repertoire import Pilot, Played, Repertoire, play
from taichi_sim.base.arrays import Floats, Ints

SENSES = ("slip", "tilt", "velocity")
REDRAWN = 32  # looks after which, in the mean, a machine that switches by chance draws again


@dataclass(frozen=True, eq=False)
class Crew:
    """Machines side by side on one course.

    Attributes:
        pilots: what plays some of them each, and of how many.
    """

    pilots: Sequence[tuple[int, Pilot]]

    @property
    def count(self) -> int:
        """How many machines."""
        return sum(count for count, _ in self.pilots)

    def __call__(self, felt: Floats, places: Floats) -> Ints:
        """The gait of each, shape (B,)."""
        ends = np.cumsum([count for count, _ in self.pilots])
        parts = zip(self.pilots, np.split(felt, ends[:-1]), np.split(places, ends[:-1]), strict=True)
        return np.concatenate([pilot(*given) for (_, pilot), *given in parts])


def fixed(gait: int) -> Pilot:
    """A pilot that never changes the gait."""
    return lambda felt, places: np.full(len(felt), gait)


def knowing_ground(course: Course, answers: Sequence[int]) -> Pilot:
    """A pilot that knows on what ground the machine's middle is, and plays the gait for that."""
    return lambda felt, places: np.array(answers)[course.kind(places)]


def staying(pilot: Pilot, looks: int) -> Pilot:
    """A pilot of one machine that obeys another one, but keeps each gait for at least ``looks`` looks."""
    kept, since = np.zeros(1, int), looks

    def pilot_that_stays(felt: Floats, places: Floats) -> Ints:
        nonlocal since
        wanted = pilot(felt, places)
        since += 1
        if wanted[0] != kept[0] and since >= looks:
            kept[:], since = wanted, 0
        return kept.copy()

    return pilot_that_stays


def sensing(switching: Switching) -> Pilot:
    """A pilot of one machine that switches by its senses alone; it begins with the gait for level ground."""
    switcher = Switcher(switching, [switching.answers[0]])
    return lambda felt, places: switcher.look(felt)


def by_chance(gaits: int, count: int, seed: tuple[int, ...]) -> Pilot:
    """A pilot that draws a gait for each machine, and draws again after ``REDRAWN`` looks in the mean."""
    rng = np.random.default_rng(seed)
    playing = rng.integers(gaits, size=count)

    def pilot(felt: Floats, places: Floats) -> Ints:
        again = rng.random(count) < 1 / REDRAWN
        playing[again] = rng.integers(gaits, size=count)[again]
        return playing.copy()

    return pilot


def exploring(course: Course, answers: Sequence[int], gaits: int, count: int, seed: tuple[int, ...]) -> Pilot:
    """A pilot that plays by turns the right gait and a drawn one, so that every gait is felt on every ground."""
    guide, chance = knowing_ground(course, answers), by_chance(gaits, count, (*seed, 0))
    often = by_chance(2, count, (*seed, 1))

    def pilot(felt: Floats, places: Floats) -> Ints:
        drawn, right = chance(felt, places), guide(felt, places)
        return np.where(often(felt, places) == 0, right, drawn)

    return pilot


def play_course(points: Floats, grounds: Grounds, seed: int, cycles: int, crew: Crew) -> Played:
    """Let a crew of machines with gaits (G, P) go along the course of a seed."""
    repertoire = Repertoire.of(machine(cycles), points)
    episodes = Episodes(repertoire.robot, grounds.world(seed), crew.count, SENSES, HERE)
    return play(episodes, repertoire, crew)


def distances(played: Played) -> Floats:
    """How far each machine went [m], shape (B,); 0 where it diverged."""
    return np.where(played.failed, 0.0, played.places[:, -1] - played.places[:, 0])


def samples(played: Played, course: Course, window: int) -> tuple[Floats, Ints, Ints]:
    """Features (N, F), gaits (N,) and grounds (N,) of looks at which both have been the same for a window."""
    kinds = course.kind(played.places)
    whole = steady(played.gaits, window) & steady(kinds, window) & ~played.failed[:, None]
    # A reading is of what was played before it: at a look the gait of that look is not felt yet.
    whole[:, 1:] &= played.gaits[:, 1:] == played.gaits[:, :-1]
    rows, looks = np.nonzero(whole)
    looks_back = looks[:, None] - np.arange(window)[::-1]
    felt = features(played.felt[rows[:, None], looks_back])
    return felt, played.gaits[rows, looks], kinds[rows, looks]
