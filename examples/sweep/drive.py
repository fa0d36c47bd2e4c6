"""Drives a P2AT straight ahead in lockstep, and says how far it came.

python drive.py PORT SPEED NAME FOLDER   (rad/s; result.json is written into the folder)
"""

import json
import re
import socket
import sys
from pathlib import Path

port, wheels, name, folder = sys.argv[1:]
link = socket.create_connection(("127.0.0.1", int(port)))
wire = link.makefile("rw", newline="\r\n", encoding="latin-1")
wire.write(f"INIT {{ClassName USARBot.P2AT}} {{Name {name}}} {{Start RobotStart1}}\r\n")
wire.write(f"DRIVE {{Left {wheels}}} {{Right {wheels}}}\r\nSYNC {{Ticks 20}}\r\n")
wire.flush()
places, ticks = [], 0
for line in wire:
    ticks += line.startswith("NFO {Status Tick}")
    found = re.search(r"GroundTruth.*Location ([-\d.]+)", line)
    if found:
        places.append(float(found[1]))
    if ticks == 2:  # where it came, and 2 s later
        break
way = round(places[-1] - places[0], 2)
Path(folder, "result.json").write_text(json.dumps({"way": way, "robot": name}))
print(f"{way} m in 2 s")
sys.exit(0 if way > 0.1 else 1)
