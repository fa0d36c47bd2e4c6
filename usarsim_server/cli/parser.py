"""The parser of the command line: errors in one line with a cure, commands in groups."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NoReturn

GROUPS: Mapping[str, Sequence[str]] = {
    "Try and look": ("demo", "console", "watch", "film"),
    "Serve": ("serve", "worlds", "robots", "import", "snapshot"),
    "Missions and studies": ("mission", "study", "share"),
    "Exploration and batches": ("explore", "radio-map", "sweep"),
    "Check": ("doctor", "conformance", "record", "replay", "bench"),
}
"""Commands of the overview by what they are for; others follow under "More"."""

_FIRST = """\
Begin with
  usarsim demo           a robot to drive in the browser, and one that wanders
  usarsim serve          a server for controllers, on port 3000
  usarsim help COMMAND   what a command does, and its options
"""


class CommandParser(argparse.ArgumentParser):
    """A parser of `argparse` whose errors are one line that names the cure."""

    def error(self, message: str) -> NoReturn:
        """Print one `error:` line and end with exit code 2."""
        cure = "" if message.endswith(")") else f" (see {self.prog} --help)"
        self.exit(2, f"error: {self.prog}: {message}{cure}\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Accept a choice; name the nearest one, or all, for a word that is none."""
        if action.choices is None or value in action.choices:
            return
        kind = "command" if isinstance(action, argparse._SubParsersAction) else "choice"
        known = [str(choice) for choice in action.choices]
        near = _nearest(str(value), known)
        cure = f"did you mean {near}?" if near else f"known are {', '.join(known)}"
        raise argparse.ArgumentError(
            action if action.option_strings else None, f"unknown {kind} {value!r} ({cure})"
        )

    def complain(self, words: Sequence[str], rest: Sequence[str]) -> NoReturn:
        """Print one `error:` line about words that no parser has taken; end with exit code 2.

        Args:
            words: the whole command line, by which the command is found that was called.
            rest: those left over.
        """
        inner = self._called(words)
        if inner is not None:
            inner.complain(words[words.index(inner.prog.split()[-1]) + 1 :], rest)
        unknown = next((word for word in rest if word.startswith("-")), None)
        if unknown is None:
            self.error(f"too many words: {' '.join(rest)}")
        option = unknown.partition("=")[0]
        known = (one[2:] for one in self._option_string_actions if one.startswith("--"))
        near = _nearest(option.lstrip("-"), known)
        self.error(f"unknown option {option}" + (f" (did you mean --{near}?)" if near else ""))

    @property
    def _subcommands(self) -> argparse._SubParsersAction[Any] | None:
        """What chooses among the subcommands; None for a parser without any."""
        return next((a for a in self._actions if isinstance(a, argparse._SubParsersAction)), None)

    def _called(self, words: Sequence[str]) -> CommandParser | None:
        """The parser of the subcommand that the words call, if there is one."""
        named = next((word for word in words if not word.startswith("-")), "")
        found = self._subcommands and self._subcommands.choices.get(named)
        return found if isinstance(found, CommandParser) else None


class ProgramParser(CommandParser):
    """The parser of the whole program; its help shows the commands in groups."""

    def format_help(self) -> str:
        """What to type first, and all commands."""
        choices = self._subcommands._choices_actions if self._subcommands else ()
        helps = {choice.dest: choice.help or "" for choice in choices}
        listed = {name for names in GROUPS.values() for name in names}
        groups = {**GROUPS, "More": sorted(helps.keys() - listed)}
        width = max(map(len, helps), default=0)
        parts = [f"{self.prog}: {self.description}\n", _FIRST]
        for title, names in groups.items():
            lines = [f"  {name:{width}}  {helps[name]}\n" for name in names if name in helps]
            if lines:
                parts.append(f"{title}\n{''.join(lines)}")
        parts.append("Options\n  -h, --help     this overview\n  -V, --version  the version\n")
        return "\n".join(parts)


def _nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word that is most similar; what finds it is loaded only for a wrong word."""
    from usarsim_server.base.tables import nearest

    return nearest(word, known)
