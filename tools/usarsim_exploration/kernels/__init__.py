"""The few loops that cost most: compiled by numba where it is installed, else numpy.

Both forms compute with whole numbers or with the same operations on the same floats, so results are
equal bit by bit (a test compares them). `USARSIM_EXPLORATION_PLAIN=1` chooses numpy.
"""

import os

try:
    if os.environ.get("USARSIM_EXPLORATION_PLAIN"):
        raise ImportError
    from usarsim_exploration.kernels.compiled import crossings, flood, march
    from usarsim_exploration.kernels.linking import expected, outlined
    from usarsim_exploration.kernels.looking import count_first, look, take_in
    from usarsim_exploration.kernels.trading import (
        agree,
        once,
        send,
        settle,
        tell,
        waiting_news,
    )  # fmt: skip

    COMPILED = True
except ImportError:
    from usarsim_exploration.kernels.plain import crossings, expected, flood, march, outlined
    from usarsim_exploration.kernels.plain_looking import count_first, look, take_in
    from usarsim_exploration.kernels.plain_trading import (
        agree,
        once,
        send,
        settle,
        tell,
        waiting_news,
    )  # fmt: skip

    COMPILED = False

__all__ = [
    "COMPILED", "agree", "count_first", "crossings", "expected", "flood", "look", "march",
    "once", "outlined", "send", "settle", "take_in", "tell", "waiting_news",
]  # fmt: skip
