"""MuJoCo: scene, stepping, pacing, contact compensation, snapshots, rays, frame conversions.

Nobody outside this room touches live MuJoCo data. `Simulation` refuses to start with a MuJoCo
release that is known to be wrong.
"""
