"""``morpholab tasks``: what robots can be asked to do."""

import argparse
from typing import Any

from optim.commands import Report, options

COMMAND = options.Command(
    "tasks",
    "list the tasks that robots can be given",
    "List the tasks that come with the lab: the robot, the worlds in which it is tried, what is raised, and when a "
    "design has succeeded. `codesign --task NAME` searches for such a design.",
    (),
)


def run(args: argparse.Namespace) -> Report:
    """Tell each task."""
    from robots.tasks import builtin_tasks

    documents, lines = list[dict[str, Any]](), list[str]()
    for name, task in builtin_tasks().items():
        worlds, asked = [world.name for world in task.worlds], [one.text for one in task.success]
        robot, objective = task.source or "", list(task.options.get("objective", []))
        documents.append(
            {
                "name": name,
                "title": task.title,
                "robot": robot,
                "worlds": worlds,
                "objective": objective,
                "success": asked,
                "free": len(task.robot.parameters),
            }
        )
        lines += [
            f"{name}: {task.title}",
            f"  {robot}, {len(task.robot.parameters)} variables, {', '.join(worlds)}",
            f"  objective {task.raised}; succeeds with {' and '.join(asked)}",
        ]
    return Report(documents, "\n".join(lines))
