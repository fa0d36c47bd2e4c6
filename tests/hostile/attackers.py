"""All attacks by name, and the process of the attackers.

`python -m hostile.attackers NAME PORTS` (from `tests`), with the ports as a JSON object, does one
attack on a server of this machine until its standard input ends; then it says on standard output
what it did, as JSON.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from benchmarks.server import CarefulClosing
from hostile.attack import Attack
from hostile.control_attacks import CONTROL_ATTACKS
from hostile.links import Damage, Site, work
from hostile.scene_attacks import SCENE_ATTACKS
from hostile.side_attacks import SIDE_ATTACKS
from hostile.web_attacks import WEB_ATTACKS
from usarsim_bench.figures import BenchError
from usarsim_server.base.launch import python
from usarsim_server.protocol.json_text import parse_json

ATTACKS: Mapping[str, Attack] = {
    one.name: one for one in (*CONTROL_ATTACKS, *SIDE_ATTACKS, *SCENE_ATTACKS, *WEB_ATTACKS)
}
"""In the order in which they are tried."""


_END_TIMEOUT = 20.0


class Attackers(CarefulClosing):
    """The attackers, as the one who started them sees them."""

    def __init__(self, name: str, ports: Mapping[str, int]) -> None:
        """Let one attack loose on the ports of a server, by the names of its READY line."""
        self._process = subprocess.Popen(
            python("-m", __name__, name, json.dumps(dict(ports))),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
        )

    def stop(self) -> Damage:
        """Call them back.

        Raises:
            BenchError: if they did not live to tell.
        """
        try:
            said, complaint = self._process.communicate("", _END_TIMEOUT)
            return Damage(**parse_json(said))
        except subprocess.TimeoutExpired:
            self.close()
            raise BenchError("the attackers did not end") from None
        except (ValueError, TypeError):
            self.close()
            last = complaint.strip().rpartition("\n")[2]
            raise BenchError(f"the attackers failed themselves: {last}") from None

    def close(self) -> None:
        """End them, whatever they are at; a second call does nothing."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()


def _main(name: str, ports: Mapping[str, int]) -> None:
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    ended = threading.Event()

    def watch() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=watch, daemon=True).start()
    attack = ATTACKS[name]
    loops = [_busy_loop() for _ in range(attack.busy_loops)]
    damage, site = Damage(), Site(ports, ended)
    work(attack.links(site), ended, damage)
    for child in loops:
        child.kill()
        child.wait()
    print(json.dumps(asdict(damage)), flush=True)


def _busy_loop() -> subprocess.Popen[bytes]:
    """A program that needs a processor, and ends with this one."""
    code = f"import os\nwhile os.getppid() == {os.getpid()}:\n for _ in range(100000): pass"
    return subprocess.Popen(python("-S", "-c", code))


if __name__ == "__main__":
    _main(sys.argv[1], parse_json(sys.argv[2]))
