"""Studies of operators: who does what when, what was measured, what it says (docs/studies.md).

`study_file` reads `study.toml`, `assignment` says which participant meets which conditions in which
order, `forms` are what participants fill in. `records` reads the log of a trial, `measures`
computes numbers from it, `dataset` collects those of all trials, `tables` writes them as tidy CSV,
`statistics`, `analysis` and `power` judge them, `report` tells it in one HTML file. `synthetic`
makes up data with a known effect. `commands` has one file per `usarsim study` command.
"""
