"""rcsssmj: the RoboCup soccer simulation server on MuJoCo."""

from __future__ import annotations

from usarsim_bench.peer import Peer

PEER = Peer(
    name="rcsssmj",
    title="RCSSServerMJ",
    home="https://gitlab.com/robocup-sim/rcssservermj",
    packages=("rcsssmj>=0.2.1,<0.3",),
    python=(10, 14),
    workload="rcsssmj_players.py",
    against="humanoids",
    same="A server with MuJoCo inside, a TCP connection for every robot, clients in another "
    "process, not in real time but as fast as it goes. Humanoids that stand and swing their arms: "
    "K1 of 22 joints there, Nao of 22 joints here; every joint is commanded 50 times a simulated "
    "second. Processor time is that of the server alone.",
    different="They wait in every cycle for all players (50 perceptions a second, objects seen in "
    "every other one); we go on without waiting and send each client 100 lines a second of joint "
    "positions, and others of sensors. Physics steps: 200 a second there, 250 here, in other "
    "models, with MuJoCo 3.5 there. They have a ball, a field and a referee, we have a hall of 82 "
    "boxes. Not compared: lasers (they have none), wheeled robots, how well anybody walks.",
    most=22,
    most_because="two teams of 11 are the most that its largest rule book allows",
)
