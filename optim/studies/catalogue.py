"""What can be reproduced, by name: items of the dissertation's chapters, each a function and what it writes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

from optim.experiments.results import scale_of


@dataclass(frozen=True)
class Item:
    """A study that repeats or extends something published.

    Its module has ``SCALES``, the study's settings by budget, and ``study(folder, settings, progress=None, ...)``:

    * ``folder`` takes the results; it is new, or that of a study of the same settings, which goes on from where it was.
      One of something else is refused by a ValueError of one line, before any work.
    * ``settings`` are any, those in ``SCALES`` or others.
    * ``progress`` is called with the fraction done.
    * ``threads``, where it is taken, are CPU threads, all available if None; they change no result.

    It writes ``summary.json`` or a table, and figures; where it returns anything, that is what ``summary.json`` holds.

    Attributes:
        source: where in the dissertation.
        title: in a line.
        module: of ``optim.studies``.
        writes: files in the folder, beside raw results.
        sweep: whether ``study`` also takes ``sweep_folder``, a sweep to read bodies from.
        jobs: whether it also takes ``jobs``, how many of its parts go on at the same time.
    """

    source: str
    title: str
    module: str
    writes: tuple[str, ...]
    sweep: bool = False
    jobs: bool = False

    def run(
        self, folder: Path, budget: str = "full", progress: Callable[[float], None] | None = None, **given: Any
    ) -> None:
        """Do the study; it goes on where its folder left off.

        Args:
            folder: new, or that of the same study.
            budget: ``"small"``, to see that it works, ``"full"``, or ``"medium"``, where the study has that.
            progress: called with the fraction done.
            given: ``sweep_folder`` and ``jobs``, where the study takes them.

        Raises:
            ValueError: in one line, for a budget that the study does not have, or a folder of something else.
        """
        module = import_module(f"optim.studies.{self.module}")
        module.study(folder, scale_of(budget, module.SCALES), progress, **given)


CATALOGUE: Mapping[str, Item] = MappingProxyType(
    {
        "sensor-placement": Item(
            "chapters 3 and 4, figures of designs, metrics and their correlation",
            "all controllers in bodies of the published grid: learnability and resistance to interference",
            "chapter3.sweep_study",
            ("table.csv", "distributions.png", "correlation.png", "examples.png"),
            sweep=True,
        ),
        "training": Item(
            "chapter 4, figure of sample efficiency",
            "evaluations that four trainers need, against what a sweep says of the bodies",
            "chapter4.training_study",
            ("summary.json", "runs.csv", "training.png"),
            sweep=True,
        ),
        "co-optimisation": Item(
            "chapter 4, figure neurips_cooptimization",
            "body and controller together beside the controller alone, and how homeostatic their solutions become",
            "chapter4.co_optimisation",
            (
                "summary.json",
                "environments-solved.csv",
                "evaluations-until-all-solved.csv",
                "homeostasis.csv.gz",
                "homeostasis-at-the-end.csv",
                "co-optimisation.png",
            ),
        ),
        "search-comparison": Item(
            "beyond chapter 4",
            "gradients beside gradient-free searches: evaluations until all environments are solved",
            "beyond.search_comparison",
            ("summary.json", "evaluations-until-all-solved.csv", "search-comparison.png"),
        ),
        "homeostasis-of-bodies": Item(
            "chapters 4 and 6",
            "whether bodies in which controllers are easily found are homeostatic",
            "chapter4.homeostasis_of_bodies",
            ("summary.json", "bodies.csv", "homeostasis-of-bodies.png"),
            sweep=True,
        ),
        "reality-gap": Item(
            "chapter 6, figure of weight manifolds",
            "controllers that still succeed when vehicle or world are changed",
            "chapter4.reality_gap",
            ("summary.json", "survival.csv", "reality-gap.png"),
            sweep=True,
        ),
        "homeostasis-objective": Item(
            "chapter 6",
            "whether homeostasis as an objective helps",
            "chapter4.homeostasis_objective",
            ("summary.json", "reported.csv", "homeostasis-objective.png"),
        ),
        "interference": Item(
            "chapter 2, tables M1 to M4 and figures",
            "which robots, trained in several environments, suffer when what helps in one harms in another",
            "chapter2.study",
            (
                *("two/tables.md", "two/changes.png", "two/changes-of-champions.png", "two/curves.png"),
                *("two/traces.png", "four/tables.md", "four/curves.png", "four/traces.png", "alone.csv"),
            ),
        ),
        "rover-success": Item(
            "chapter 3, figure of landscapes, empirical model",
            "all controllers in the canonical and the best body of the two-wheel vehicle, as rigid bodies",
            "chapter3.rover_success",
            ("summary.json", "rover-success.csv", "rover-success.png"),
        ),
        "rover-sweep": Item(
            "chapter 3, figure of distributions, empirical model",
            "learnability of random bodies of the two-wheel vehicle, as rigid bodies and in theory",
            "chapter3.rover_sweep",
            ("summary.json", "rover-sweep.csv", "rover-sweep.png"),
        ),
        "rover-pre-optimisation": Item(
            "chapter 3, the empirical model",
            "the search for the two-wheel vehicle's base body: distance from the light against effort of its drives",
            "chapter3.rover_pre_optimisation",
            ("summary.json", "rover-fronts.csv", "rover-pre-optimisation.png"),
        ),
        "shape-change": Item(
            "chapter 5, table of simulation results and figure of searches",
            "searches for gaits on flat ground and up a hill, with shape, orientation and control free or fixed",
            "chapter5.study",
            ("table.md", "table.csv", "curves.png", "curves.csv", "summary.json", "runs"),
        ),
        "gait-hunt": Item(
            "chapter 5, discussion: why the search did not find inching on the hill",
            "evolution as published, on cycles, along gradients and both: gaits that climb 15 degrees, at equal cost",
            "beyond.gait_hunt.study",
            ("table.md", "table.csv", "generations.csv", "hunt.png", "summary.json", "runs", "gaits"),
            jobs=True,
        ),
        "gait-climb": Item(
            "chapter 5, discussion: why the search did not find inching on the hill",
            "a program that finds gaits which climb 15 degrees: random ones, their kinds refined, the best led uphill",
            "beyond.gait_hunt.climb",
            ("table.md", "seeds.csv", "steps.csv", "climb.png", "summary.json", "runs", "gaits"),
            jobs=True,
        ),
        "friction-sweeps": Item(
            "chapter 5, figure of friction, d and e",
            "inching on flat ground with other friction of sliding and gripping feet",
            "chapter5.friction",
            ("friction.md", "friction.csv", "friction.png", "summary.json"),
        ),
        "slope-sweep": Item(
            "chapter 5, transition of gaits",
            "rolling and inching up slopes, and the slope at which inching overtakes",
            "chapter5.slopes",
            ("slopes.md", "slopes.csv", "slopes.png", "summary.json"),
        ),
        "hand-gait-sensitivity": Item(
            "chapter 5, discussion of the simulator's parameters",
            "whether rolling and inching survive other moduli, densities, time steps, pressures and voxels",
            "chapter5.sensitivity",
            ("sensitivity.md", "sensitivity.csv", "sensitivity.png", "summary.json"),
        ),
        "soft-robot-metrics": Item(
            "chapters 4 and 6, metrics of complex robots",
            "learnability and interference of shapes and orientations of the soft robot, by sampled gaits",
            "chapter5.metrics",
            ("metrics.csv", "metrics.png", "summary.json"),
        ),
    }
)
