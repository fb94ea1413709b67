"""What tests compute with: a precision, and a number of threads.

For another one Taichi starts again and loads all kernels anew, so tests go in an order in which it seldom has to. The
default is double precision on one thread. What differs is told here by parts of a test's name.

Each process compiles the kernels that it launches. So those of an engine in a precision are, as far as that goes, one
process's: it stays with them, and files without kernels fill the time of whoever has none left.
"""

from collections import Counter
from functools import cache
from pathlib import Path

SINGLE = (
    # Files that are so for the most part.
    "commands/test_graded_commands.py",
    "commands/test_task_file.py",
    "gym/test_lattice_robot.py",
    "hardware/test_rig_response.py",
    "inflatable/view/test_picture.py",
    "inflatable/view/test_shape.py",
    "lattice_robot/test_lattice_robot_motion.py",
    "pipeline/test_pipeline.py",
    "problems/test_several_cores_searches.py",
    "quadruped/test_quadruped_motion.py",
    "robots/test_ground.py",
    "robots/test_tasks.py",
    "rover/test_rover_motion.py",
    "runs/test_ray.py",
    "studies/test_body_and_learning.py",
    "studies/test_evolving_bodies.py",
    "studies/test_light_seeking.py",
    "studies/test_tasks_study.py",
    "studies/test_uncertain_walking.py",
    "view/test_lattice_states.py",
    "view/test_motion.py",
    "view/test_paraview.py",
    "view/test_pictures.py",
    "view/test_read_outs.py",
    "view/test_rerun_file.py",
    "view/test_uneven.py",
    "view/test_view.py",
    # Single tests.
    "a_lattice_robot_that_diverges",
    "browser/test_explorer.py::test_a_robot_that_changes",
    "f32",
    "LatticeRobot-v0",
    "Light-v0",
    "Pancake-v0",
    "picture_in_water",
    "rover-pre-optimisation",
    "single_precision",
    "test_all_that_environments_tell_converts_to_torch[Push]",
    "test_bench.py::test_a_device_is_compared",
    "test_bench.py::test_rates_of_the_lattice",
    "test_bench.py::test_the_peak_of_a_core",
    "test_copies.py::test_a_copy_goes_on_with_the_same_bits[Pancake",
    "test_copies.py::test_a_copy_goes_on_with_the_same_bits[Push",
    "test_copies.py::test_a_copy_goes_on_with_the_same_bits[Walk",
    "test_faults.py::test_a_fault_costs_nothing_but_the_command[disk-calibrate",
    "test_faults.py::test_a_fault_costs_nothing_but_the_command[disk-pipeline",
    "test_faults.py::test_a_fault_costs_nothing_but_the_command[disk-simulate a gait",
    "test_floor_friction.py::test_feet_slide_as_the_floor_says",
    "test_freeform_study.py::test_runs_are_judged",
    "test_ground_friction.py::test_judges",
    "test_gym.py::test_numbers_above_a_half_are_on",
    "test_lattice_engine.py::test_memory_per_robot",
    "test_lattice_engine.py::test_nothing_compiles_again",
    "test_lattice_engine.py::test_states_are_in_double_precision",
    "test_measure_command.py::test_lattice_robots",  # and those that feel
    "test_minibatches.py::test_gaits_of_the_inflatable",
    "test_props.py::test_a_box_gives_way",
    "test_readme.py::test_the_example_runs",
    "test_report.py::test_the_best_gait_in_motion",
    "test_rigid_batch.py::test_frames_are_the_states",
    "test_rigid_batch.py::test_nothing_explodes_in_two_thousand",
    "test_rigid_batch.py::test_threads_change_no_bit",
    "test_rigid_files.py::test_an_ant",
    "test_rigid_input.py::test_bad_input",
    "test_rover.py::test_as_many_controllers_succeed",
    "test_rover.py::test_wires_cross",
    "test_rover_studies.py::test_a_grid_shares",
    "test_rover_studies.py::test_objectives_of_the_base_body",
    "test_stages.py::test_a_judgement",
    "test_stepwise.py::test_a_session_may_hold",
    "test_stepwise.py::test_what_a_session_is_given",
    "test_swimming.py::test_the_command_takes",
    "test_v1_runs.py::test_the_command_goes_on_with_them[gait]",
    "test_vector.py::test_statistics_of_gymnasium",
    "test_view_command.py::test_a_pouch_has_feet",
    "test_view_command.py::test_files_of_designs",
    "test_view_command.py::test_gait_tables_move",
    "test_view_command.py::test_soft_robots",
    "test_view_command.py::test_the_best_of_a_run_of_gaits",
)
DOUBLE = (
    "f64]",
    "gym/test_lattice_robot.py::test_what_the_way_to_a_light_is_worth",
    "test_uncertain_walking.py::test_speeds_are_those",
    "gym/test_lattice_robot.py::test_no_action",
    "view/test_rerun_file.py::test_parts_are_meshes_with_poses[vehicle]",
    "view/test_pictures.py::test_every_robot_has_a_picture[vehicle]",
    "view/test_view.py::test_every_robot_has_a_picture_with_its_channels[vehicle]",
    "single_precision_tensors",
)
TWO_THREADS = (
    "co-optimisation",
    "homeostasis-objective",
    "search-comparison",
    "test_bits_depend_on_no_batch_width_thread_or_launch[2",
    "test_interference_study.py::test_runs_depend",
    "test_lattice_engine.py::test_a_robot_does_not_feel",
    "test_neighbours_threads_and_width",
    "test_threads_change_no_bit",
    "test_vehicle_studies.py::test_the_curve_of_co_optimisation",
    "test_walker.py::test_results_depend",
)
# Files that compile more for rigid robots than for lattices.
RIGID = (
    "/rigid/",
    "/articulated/",
    "/quadruped/",
    "every_kind_of_robot",
    "test_light_seekers",
    "test_articulated_physics",
)

ROOT = Path(__file__).parents[2]
Kernels = tuple[str, str]


def precision(test: str) -> str:
    """The precision, ``"f64"`` or ``"f32"``, in which a test of this name computes."""
    return "f32" if _in(test, SINGLE) and not _in(test, DOUBLE) else "f64"


def place(test: str) -> tuple[str, bool]:
    """Where a test belongs in the order: double precision first, and what needs several threads behind the rest."""
    return "double" if precision(test) == "f64" else "single", _in(test, TWO_THREADS)


def kernels_of(test: str) -> Kernels | None:
    """Whose kernels a test launches for the most part, and in which precision; None if its file launches none."""
    return ("rigid" if _in(test, RIGID) else "lattice", precision(test)) if _launches(test.split("::")[0]) else None


def next_scope(kernels: dict[str, Kernels | None], last: Kernels | None, of_others: set[Kernels]) -> str:
    """Which of the waiting groups of tests, in their order, a process takes next.

    Args:
        kernels: that each of them launches.
        last: that the process launched last.
        of_others: that the other processes launched last.

    Returns:
        The first that launches the same; or what no other does; or nothing; or what there is most of.
    """
    count = Counter(kernels.values())
    ranks = {kind: (kind is None or kind != last, kind in of_others, kind is None, -n) for kind, n in count.items()}
    return min(kernels, key=lambda scope: ranks[kernels[scope]])


@cache
def _launches(file: str) -> bool:
    return "mark.kernels" in (ROOT / file).read_text()


def _in(test: str, parts: tuple[str, ...]) -> bool:
    return any(part in test for part in parts)
