"""Multi-robot exploration under limited radio, as a benchmark: `usarsim explore`.

Places are cells, (column, row) from the top left, angles rad and clockwise, times steps. A step has
no duration; `Environment.cell` says how many metres a cell is wide.
"""
