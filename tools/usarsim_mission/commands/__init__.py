"""The subcommands of `usarsim mission`, one file each; `usarsim_mission.command` lists them."""
