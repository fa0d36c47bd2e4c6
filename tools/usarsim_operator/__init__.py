"""The operator's gateway: pages of a browser on one side, a server of robots on the other.

A gateway is an ordinary client of the server: one connection per robot of its own, the image port,
and the scene port where there is one. Its rules (`arbiter`, `watchdog`, `timed_moves`, `alarms`,
`telemetry`, `roles`, `messages`) know no socket and no clock; `station` brings them together, `web`
serves pages. What a page and a gateway say to each other is docs/console-protocol.md.
"""
