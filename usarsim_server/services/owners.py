"""Tells whose a robot is: the machine from which its control connection comes."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable, Mapping
from functools import lru_cache

Owners = Callable[[], Mapping[str, str]]
"""The addresses of the control connections of all robots in the world, by `values.name_key`."""

NOBODY: Owners = dict
"""Those of a world without robots."""


def same_machine(one: str, other: str) -> bool:
    """Whether two addresses of clients are those of one machine.

    A program on the server's own machine comes from whichever address it dialled: 127.0.0.1, or
    one of the network.
    """
    return one == other or (_is_here(one) and _is_here(other))


@lru_cache(maxsize=256)
def _is_here(address: str) -> bool:
    """Whether an address is one of this machine: a socket can be bound to no other."""
    try:
        version = ipaddress.ip_address(address.partition("%")[0]).version
        family = socket.AF_INET if version == 4 else socket.AF_INET6
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((address, 0))
    except (OSError, ValueError):
        return False
    return True
