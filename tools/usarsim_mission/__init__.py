"""Missions with zones and victims, and the referee that scores them (docs/missions.md).

`model` is what a referee knows of a mission and its world, `runlog` the folder of a run. Nothing
here knows the server from inside.
"""
