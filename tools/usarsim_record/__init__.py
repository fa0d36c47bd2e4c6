"""`usarsim record` and `usarsim replay`: a session between a controller and a server, kept and
played again.

`proxy` stands between the two and writes a file (`recording`); `player` takes the controller's
side again; `digest` and `compare` judge what the server says to it.
"""
