"""Tokens that outlive their gateway, in a file, so that pages come back by themselves."""

from __future__ import annotations

import contextlib
from pathlib import Path

from usarsim_operator.roles import Role, Tokens
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import reason
from usarsim_server.base.private import exposed, private
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import read_toml

_LEAST, _MOST = 16, 200
"""Characters of a token; 16 of ours have 96 bits."""


def kept_tokens(path: Path) -> Tokens:
    """The tokens of a file, one key for each role; it is made if it is not there.

    Raises:
        UsarsimError: if it cannot be had, others may read or change it, or something is wrong in
            it.
    """
    try:
        with contextlib.suppress(FileExistsError):
            # It has its mode from the beginning: nobody sees it in between.
            fresh = Tokens()
            with open(path, "x", opener=private) as file:
                file.writelines(f'{role.value} = "{fresh[role]}"\n' for role in Role)
        open_to_others = exposed(path)
    except OSError as error:
        why = f"{reason(error)} (name a file in a folder of yours)"
        raise UsarsimError(f"--tokens: {path}: {why}") from None
    if open_to_others:
        cure = f"chmod 600 {path}, or delete it for new tokens"
        raise UsarsimError(f"--tokens: {path}: others may read or change it (cure: {cure})")
    table = Table(read_toml(path, UsarsimError), path, UsarsimError)
    tokens: dict[Role, str] = {}
    for role in Role:
        token, cure = table.text(role.value), "delete the file for new ones"
        if not _LEAST <= len(token) <= _MOST or not token.isascii() or not token.isprintable():
            wanted = f"must have {_LEAST} to {_MOST} printable characters of ASCII"
            raise table.error(role.value, wanted, cure)
        if token in tokens.values():
            raise table.error(role.value, "is the token of another role, too", cure)
        tokens[role] = token
    table.finish()
    return Tokens(tokens)
