"""The text protocol of the robot control port, without a socket, a clock or a thread.

Bytes of a connection pass through these modules in this order:

    framing.LineFramer    bytes in any chunking   -> complete lines
    grammar.parse_line    one line                -> commands (word and segments)
    commands.interpret    one command             -> a typed, frozen request
    dialects              requests seen so far    -> the dialect of the answers
    messages              plain values            -> one line of text
    messages.encode       one line of text        -> bytes for the socket

`numbers` reads and prints every number on both ways, `values` holds the types all of them share.
Nothing here raises on input that a client sent: what cannot be read has a defined meaning.
"""
