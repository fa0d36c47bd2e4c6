"""MuJoCo: scene, stepping, pacing, contact compensation, snapshots, rays, frame conversions.

Nobody outside this room touches live MuJoCo data. Importing the room raises `UsarsimError` for a
MuJoCo release that is known to be wrong.
"""
