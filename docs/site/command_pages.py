"""Pages of the command line, made from its parser, so that they are what ``--help`` says."""

import argparse
import re
from collections.abc import Iterable
from importlib import import_module

from optim.cli import build_parser
from optim.commands.options import Command
from robots.robot import KINDS

INTRODUCTION = """# Command line

Each command has a page, made from the parser that reads it; `morpholab COMMAND --help` says the same. Options of a kind
of robot join when the command line names the robot: `morpholab codesign --robot walker --help`.

Every command takes `--json`: it then prints one JSON document, and nothing else, on standard output. Exit codes: 0; 2
for bad input, told in one line before any work; 1 for work that failed; 130 when interrupted; 143 when asked to end
(SIGTERM); 129 when the terminal was closed (SIGHUP); 141 when nobody reads the output any more.
`MORPHOLAB_DEBUG=1` shows the traceback of an error.

| command | does |
| --- | --- |
"""


def command_pages() -> dict[str, str]:
    """Text of all pages by their place: the first lists the commands, then one a command."""
    commands = next(action for action in build_parser()._actions if isinstance(action.choices, dict))
    helps = {action.dest: action.help or "" for action in commands._choices_actions}
    rows = [f"| [`morpholab {name}`]({name}.md) | {_text(helps[name])} |" for name in commands.choices]
    pages = {"commands/index.md": INTRODUCTION + "\n".join(rows) + "\n"}
    for name, parser in commands.choices.items():
        command: Command = import_module(f"optim.commands.{name.replace('-', '_')}").COMMAND
        pages[f"commands/{name}.md"] = _page(command, parser)
    return pages


def _page(command: Command, parser: argparse.ArgumentParser) -> str:
    parts = [f"# morpholab {command.name}", _text(command.description)]
    for group in parser._action_groups:
        parts += _group(group.title or "", group._group_actions)
    if command.options_of is not None:
        known = {action.dest for action in parser._actions}
        for name in KINDS.builtin:
            own = argparse.ArgumentParser(add_help=False)
            for option in command.options_of(KINDS[name]):
                if option.name not in known:
                    option.add(own)
            parts += _group(f"{KINDS[name].title}, `--robot {name}`", own._actions)
    return "\n\n".join(parts) + "\n"


def _group(title: str, actions: Iterable[argparse.Action]) -> list[str]:
    """The heading and the table of options, nothing if there are none."""
    rows = [f"| {_spelling(action)} | {_text(action.help or '')} |" for action in actions if _shown(action)]
    if not rows:
        return []
    titles = {"options": "Options", "positional arguments": "Arguments"}
    heading = titles.get(title, title[:1].upper() + title[1:])
    return [f"## {heading}", "\n".join(["| option | meaning |", "| --- | --- |", *rows])]


def _shown(action: argparse.Action) -> bool:
    return action.help != argparse.SUPPRESS and action.dest != "help"


def _spelling(action: argparse.Action) -> str:
    value = "" if action.nargs == 0 else _value(action)
    words = [*action.option_strings[:1], *([value] if value else [])]
    required = " (required)" if action.required and action.option_strings else ""
    return " ".join(f"`{_cell(word)}`" for word in words) + required


def _value(action: argparse.Action) -> str:
    if isinstance(action.metavar, str):
        return action.metavar
    if action.choices is not None:
        return ",".join(str(choice) for choice in action.choices)
    return action.dest.upper().replace("_", "-")


def _text(text: str) -> str:
    """A help as Markdown: options as code, and nothing that would be taken for a tag or an emphasis."""
    text = re.sub(r"[<*_\[\]]", lambda found: "\\" + found[0], text.replace("%%", "%"))
    return _cell(re.sub(r"(?<![\w`-])--[a-z][\w-]*", lambda found: f"`{found[0]}`", text))


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
