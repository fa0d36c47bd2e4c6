"""Tables of YAML and JSON files, as strict as those of TOML: no key twice, no alias, plain values.

JSON is read as the YAML that it is.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.lined import LinedTable, Place
from usarsim_server.base.toml import MAX_DEPTH, read_text


def open_marked_up(path: Path, error: type[UsarsimError]) -> LinedTable:
    """The top table of a YAML or JSON file.

    Raises:
        error: it cannot be read, is neither, or is no table; names the line.
    """
    reader = _Reader(path, error)
    text = read_text(path, error)
    try:
        for token in yaml.scan(text, yaml.SafeLoader):
            if isinstance(token, yaml.AliasToken | yaml.AnchorToken):
                raise reader.refuse(token, "an anchor or alias", "write the values themselves")
        top = yaml.compose(text, yaml.SafeLoader)
        content = reader.value(top, ()) if top is not None else {}
    except yaml.MarkedYAMLError as cause:
        mark = cause.problem_mark or cause.context_mark
        where = None if mark is None else f"line {mark.line + 1}"
        problem = f"is not valid YAML: {cause.problem or cause.context}"
        raise error(at(path, problem, "mend the line", where=where)) from None
    except (yaml.YAMLError, RecursionError, ValueError) as cause:
        problem = f"is not valid YAML: {str(cause).splitlines()[0]}"
        raise error(at(path, problem, "mend the file, or write TOML")) from None
    if not isinstance(content, dict):
        raise error(at(path, "is no table", "write key: value"))
    return LinedTable.top(content, path, error, lambda: reader.lines)


class _Reader:
    """Makes plain values of nodes and remembers where keys stand."""

    def __init__(self, path: Path, error: type[UsarsimError]) -> None:
        self._path, self._error = path, error
        self.lines: dict[Place, int] = {}
        self._plain = yaml.constructor.SafeConstructor()

    def value(self, node: Any, place: Place) -> Any:
        """The value of a node."""
        if len(place) > MAX_DEPTH:
            raise self.refuse(node, "nested too deeply", f"nest at most {MAX_DEPTH} deep")
        if isinstance(node, yaml.ScalarNode):
            return self._plain.construct_object(node)
        if isinstance(node, yaml.SequenceNode):
            values = []
            for number, one in enumerate(node.value):
                self.lines[*place, number] = one.start_mark.line + 1
                values.append(self.value(one, (*place, number)))
            return values
        found: dict[str, Any] = {}
        for key, one in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else None
            if name is None or name in found:
                problem = "a key that is no word" if name is None else f"{name} is given twice"
                raise self.refuse(key, problem, "write each key once")
            self.lines[*place, name] = key.start_mark.line + 1
            found[name] = self.value(one, (*place, name))
        return found

    def refuse(self, node: Any, problem: str, cure: str) -> UsarsimError:
        """The error for a part of the file."""
        where = f"line {node.start_mark.line + 1}"
        return self._error(at(self._path, problem, cure, where=where))
