"""A robot of free form: from random cells to a walker, by its gradients.

python examples/freeform.py                                 three minutes on one core; writes walker.json and walker.png
morpholab codesign --robot examples/freeform.py --method race --generations 100 --out runs/walker
morpholab view walker.json --out walker.html
morpholab export walker.json --parts walker.3mf
"""

from pathlib import Path

from morpholab import FreeformActuation, FreeformRobot, Grid, Material, Palette, RobotProblem, Terrain, Tissue, maximise
from robots.view.picture import save_robot_picture

muscle = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, name="muscle")
rubber = Material(2e5, 1e3, static_friction=0.3, kinetic_friction=0.2, name="slippery rubber")

# Every cell of 12 x 4 x 4 may be missing, a muscle of its own amplitude and phase, or passive; left mirrors right.
robot = FreeformRobot(
    grid=Grid((12, 4, 4), voxel_size=0.01, symmetry="y"),
    palette=Palette((Tissue(muscle), Tissue(rubber, muscle=False))),
    actuation=FreeformActuation(channels=6),  # as many waves as the rig has lines for
)

if __name__ == "__main__":
    found = maximise(RobotProblem(robot), "race", generations=110, climbers=4, halving=4, moves=80)
    print(found.score, "lengths of the grid per second")
    walker = robot.design(found.point)
    walker.save((), Path("walker.json"))
    save_robot_picture(walker, Terrain(), Path("walker.png"))
