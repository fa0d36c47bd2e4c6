"""Films of recorded console sessions, from any viewpoint (docs/film.md).

`story` reads what a recording tells of the world, `model` makes of it what MuJoCo can draw, `views`
says from where, `drawing` draws it with the server's own renderer, `command` writes the file.
"""
