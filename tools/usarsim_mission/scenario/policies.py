"""Names of what robots may do while nobody drives them."""

from __future__ import annotations

from importlib.metadata import entry_points

from usarsim_server.base.tables import Table, suggest

PRESENT_POLICIES = ("stop", "hold", "patrol", "explore", "search")
"""Of the console; packages add theirs by this group of entry points."""
POLICY_GROUP = "usarsim.policies"


def policies() -> tuple[str, ...]:
    """All policies: those of the console and those of installed packages."""
    return (*PRESENT_POLICIES, *sorted(one.name for one in entry_points(group=POLICY_GROUP)))


def read_policy(table: Table, key: str) -> str:
    """Read the name of a policy.

    Raises:
        UsarsimError: of the table's kind; there is no such policy.
    """
    word = table.text(key)
    if word not in PRESENT_POLICIES and word not in policies():  # to look for those takes 15 ms
        raise table.error(key, f"{word!r} is not known", suggest(word, policies()))
    return word
