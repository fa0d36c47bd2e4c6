"""Let atheris look for inputs that the readers cannot stand: `make fuzz SECONDS=60`.

    python tests/fuzz/run.py --seconds 60 [--jobs 2] [--keep DIR] [TARGET ...]

Each target runs in a process of its own. What is found is written to `tests/fuzz/corpus/TARGET`,
where the test suite tries it from then on, and printed in base64; the exit code is 1 then.
`--keep` names a folder in which inputs that led somewhere new are kept from one run to the next.
"""

from __future__ import annotations

import argparse
import base64
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
PATIENCE = 60
"""s of wall time for one input; what takes so long is reported as a hang."""
MEMORY = 2048
"""MiB that a target may use."""


def fuzz(name: str, flags: list[str]) -> None:
    """Fuzz one target in this process, for ever or as long as the flags of libFuzzer say."""
    import atheris

    packages = ["usarsim_server", "usarsim_maps", "usarsim_record", "tomllib"]
    with atheris.instrument_imports(include=packages):
        import targets

    run = targets.TARGETS[name].run
    atheris.Setup([sys.argv[0], *flags], run)
    atheris.Fuzz()


def one(name: str, seconds: int, keep: Path) -> tuple[bool, str]:
    """Fuzz a target in another process; whether all is well, and a row of the table."""
    import targets

    chosen = targets.TARGETS[name]
    seeds, finds = keep / name, targets.CORPUS / name
    seeds.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(chosen.seeds()):
        (seeds / f"seed-{number}").write_bytes(seed)
    for path in finds.glob("*"):
        shutil.copy(path, seeds)
    crashes = keep / f"{name}-crashes"
    crashes.mkdir(exist_ok=True)
    flags = [f"-max_total_time={seconds}", f"-timeout={PATIENCE}", f"-rss_limit_mb={MEMORY}"]
    flags += [f"-max_len={chosen.longest}", f"-artifact_prefix={crashes}/", "-print_final_stats=1"]
    log = keep / f"{name}.log"
    began = time.monotonic()
    with log.open("w") as stream:
        code = subprocess.run(
            [sys.executable, __file__, "--one", name, *flags, str(seeds)],
            stdout=stream,
            stderr=subprocess.STDOUT,
            check=False,
        ).returncode
    said = log.read_text(errors="replace")
    runs = re.findall(r"number_of_executed_units: *(\d+)", said)
    found = [path for path in crashes.iterdir() if not path.name.startswith("slow-unit")]
    told = ""
    for path in found:
        finds.mkdir(parents=True, exist_ok=True)
        kept = Path(shutil.move(path, finds / path.name[:20]))
        told += f"\n  {kept.name}: {base64.b64encode(kept.read_bytes()).decode()}"
    took = time.monotonic() - began
    verdict = "ok" if not code and not found else f"FOUND {len(found)}, code {code}, see {log}"
    row = f"{name:20} {runs[-1] if runs else '?':>10} runs {took:6.0f} s  {verdict}{told}"
    return not code, row


def main() -> int:
    """Fuzz all targets, or some."""
    import targets

    parser = argparse.ArgumentParser(description="Fuzz the readers of bytes from outside.")
    parser.add_argument("--seconds", type=int, default=60, help="for each target (default 60)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at the same time")
    parser.add_argument("--keep", type=Path, help="keep inputs there from one run to the next")
    parser.add_argument("target", nargs="*", help=f"of {', '.join(sorted(targets.TARGETS))}")
    chosen = parser.parse_args()
    if unknown := set(chosen.target) - set(targets.TARGETS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    keep = chosen.keep or Path(tempfile.mkdtemp(prefix="usarsim-fuzz-"))
    keep.mkdir(parents=True, exist_ok=True)
    well = True
    with ThreadPoolExecutor(chosen.jobs) as pool:
        names = chosen.target or sorted(targets.TARGETS)
        for fine, row in pool.map(lambda name: one(name, chosen.seconds, keep), names):
            print(row, flush=True)
            well = well and fine
    if well and chosen.keep is None:
        shutil.rmtree(keep)
    return 0 if well else 1


if __name__ == "__main__":
    sys.path.insert(0, str(HERE))
    if sys.argv[1:2] == ["--one"]:
        fuzz(sys.argv[2], sys.argv[3:])
    else:
        sys.exit(main())
