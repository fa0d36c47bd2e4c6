"""The subcommands of `usarsim explore`: each module has `add_parser`; a new file is enough."""
