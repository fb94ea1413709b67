"""Tasks as options: those that come with the lab, and TOML documents whose keys are the names of options."""

import argparse
import json
from typing import Any

from optim.commands.options import Option, file_text
from robots.tasks import builtin_tasks, find_task
from taichi_sim.base.checks import nearest

TASK = Option(
    "task",
    f"one of {', '.join(builtin_tasks())}; or TOML with options by name, such as terrain = ['flat', 'hill:15']; the "
    "command line counts more",
    file_text,
    "NAME|FILE",
)
SEED_OR_SEEDS = (("seed", "seeds"), ("seeds", "seed"))
OWN = ("help", "task", "out", "resume", "evaluations", "quiet", "json")  # options that say nothing of the task


def take_task(args: argparse.Namespace) -> None:
    """Set what the command line leaves open to what the task of ``--task`` says.

    Raises:
        ValueError: if there is none of that name, or its file cannot be read, or it has a key that is no option.
    """
    if args.task is None:
        return
    parser: argparse.ArgumentParser = args.parser
    known = {a.dest: a for a in parser._actions if a.option_strings and a.dest not in OWN}
    task, arguments = find_task(args.task), list[str]()
    for key, value in task.options.items():
        action = known.get(key)
        if action is None:
            raise ValueError(f"task: {args.task} has an unknown key {key!r}{nearest(key, known)}")
        arguments += _arguments(action, value)
    given, _ = parser.parse_known_args(["--out", ".", *arguments])
    # One seed and several are two ways to say the same, of which the command line's counts.
    excluded = {"set", *(other for one, other in SEED_OR_SEEDS if getattr(args, one) is not None)}
    _complete_settings(args, given)
    for dest in known:
        if dest not in excluded and getattr(args, dest) is None:
            setattr(args, dest, getattr(given, dest))


def _complete_settings(args: argparse.Namespace, given: argparse.Namespace) -> None:
    """Add what the task's ``[set]`` says and the command line does not; of equal names the last counts."""
    names = [text.partition("=")[0].replace("-", "_") for text in given.set or ()]
    told = {name for name in names if getattr(args, name, None) is not None} | ({"seed"} if args.seeds else set())
    left = [text for text, name in zip(given.set or (), names, strict=True) if name not in told]
    args.set = [*left, *(args.set or ())] or None


def _arguments(action: argparse.Action, value: Any) -> list[str]:
    """The words of a command line that say the same."""
    option = action.option_strings[-1]
    if action.nargs == 0:
        if not isinstance(value, bool):
            raise ValueError(f"task: {option.lstrip('-')}: {value!r} is not allowed; give true or false")
        return [option] * value
    if isinstance(value, dict):
        value = [f"{name}={json.dumps(setting, default=str)}" for name, setting in value.items()]
    if not isinstance(value, list):
        return [f"{option}={value}"]
    if isinstance(action, argparse._AppendAction):
        return [f"{option}={item}" for item in value]
    return [f"{option}={','.join(map(str, value))}"]
