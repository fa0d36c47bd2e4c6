"""Levels of a run: who moves robots, makes their scans, and says which links exist.

`grid` computes it on the cells of the true world; `server` drives robots of a USARSim server by the
text protocol. Strategies, maps, messages and results are the same. (A package of its own, so that
neither needs the other: a run on the grid opens no socket.)
"""
