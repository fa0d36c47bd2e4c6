"""`usarsim conformance`: does a server speak the USARSim protocol? A verdict for every rule.

The kit knows a server by its ports only. A rule is one function in a file of `checks/` (see
`registry.check`); the runner judges a server by all of them, in every dialect that it speaks.
`tests/conformance` proves that the checks can fail: `mutants` are proxies that make one known fault
each, `planted` are edits of the server.
"""
