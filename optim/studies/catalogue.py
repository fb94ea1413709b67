"""Studies by name: those of the dissertation's chapters and beyond, and those of installed packages."""

from collections.abc import Callable
from pathlib import Path

from optim.experiments.study import Study, StudyReport
from taichi_sim.base.registry import Registry

STUDIES: Registry[Study] = Registry(
    "morpholab.studies",
    "study",
    {
        "sensor-placement": "optim.studies.chapter3.sweep_study:STUDY",
        "training": "optim.studies.chapter4.training:STUDY",
        "co-optimisation": "optim.studies.chapter4.co_optimisation:STUDY",
        "search-comparison": "optim.studies.beyond.search_comparison:STUDY",
        "homeostasis-of-bodies": "optim.studies.chapter4.homeostasis_of_bodies:STUDY",
        "reality-gap": "optim.studies.chapter4.reality_gap:STUDY",
        "homeostasis-objective": "optim.studies.chapter4.homeostasis_objective:STUDY",
        "interference": "optim.studies.chapter2.study:STUDY",
        "rover-success": "optim.studies.chapter3.rover_success:STUDY",
        "rover-sweep": "optim.studies.chapter3.rover_sweep:STUDY",
        "rover-pre-optimisation": "optim.studies.chapter3.rover_pre_optimisation:STUDY",
        "shape-change": "optim.studies.chapter5.study:STUDY",
        "freeform": "optim.studies.beyond.freeform:STUDY",
        "gait-hunt": "optim.studies.beyond.gait_hunt.study:STUDY",
        "gait-climb": "optim.studies.beyond.gait_hunt.climb:STUDY",
        "tasks": "optim.studies.beyond.tasks:STUDY",
        "body-and-learning": "optim.studies.beyond.body_and_learning.study:STUDY",
        "pouches-and-learning": "optim.studies.beyond.body_and_learning.pouches:STUDY",
        "evolving-bodies": "optim.studies.beyond.evolving_bodies:STUDY",
        "evolving-vehicles": "optim.studies.beyond.evolving_vehicles.study:STUDY",
        "universal-control": "optim.studies.beyond.body_and_learning.universal:STUDY",
        "forgetting": "optim.studies.beyond.forgetting.study:STUDY",
        "light-seeking": "optim.studies.beyond.light_seeking:STUDY",
        "uncertain-walking": "optim.studies.beyond.uncertain_walking:STUDY",
        "sense-and-switch": "optim.studies.beyond.sense_and_switch.study:STUDY",
        "robust-gaits": "optim.studies.beyond.robust_gaits.study:STUDY",
        "capped-gaits": "optim.studies.beyond.robust_gaits.capped:STUDY",
        "robust-searches": "optim.studies.beyond.robust_gaits.searches:STUDY",
        "bladder-layouts": "optim.studies.beyond.bladder_layouts:STUDY",
        "inflatable-gradients": "optim.studies.beyond.inflatable_gradients:STUDY",
        "friction-sweeps": "optim.studies.chapter5.friction:STUDY",
        "hardware-friction": "optim.studies.chapter5.hardware_friction:STUDY",
        "slope-sweep": "optim.studies.chapter5.slopes:STUDY",
        "hand-gait-sensitivity": "optim.studies.chapter5.sensitivity:STUDY",
        "soft-robot-metrics": "optim.studies.chapter5.metrics:STUDY",
    },
    instances_of=Study,
)

# What tells of a study's folder, by the name of its file of settings.
REPORTS: Registry[Callable[[Path], StudyReport]] = Registry(
    "morpholab.reports",
    "report",
    {
        "sweep": "optim.studies.chapter3.sweep_study:report",
        "training": "optim.studies.chapter4.training:report",
        "interference": "optim.studies.chapter2.study:report",
        "measures": "optim.experiments.body_report:report",
    },
)
