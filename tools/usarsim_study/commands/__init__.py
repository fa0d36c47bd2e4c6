"""One file per `usarsim study` command; `command.COMMANDS` names them."""
