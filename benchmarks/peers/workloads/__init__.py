"""Programs that other simulators run; each knows its simulator and the work, nothing of ours.

    python -I SCRIPT WORK.json RESULT.json

`WORK.json` is what `benchmarks.peers.work` writes, `RESULT.json` what
`benchmarks.peers.work` reads.
"""
