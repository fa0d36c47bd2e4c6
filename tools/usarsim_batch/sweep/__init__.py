"""Sweeps: a matrix of parameters of servers and of the programs that control robots in them."""
