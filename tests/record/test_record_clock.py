"""At which simulated moment a controller did something."""

from __future__ import annotations

from usarsim_record.recording import CLIENT, DATA, END, OPEN, SERVER, Event
from usarsim_record.session_clock import SessionClock, cues


def test_cues_follow_the_time_that_was_told() -> None:
    """Before any time is told pauses count; then what was told, on any connection, since the first
    time."""
    events = [
        Event(0.0, 1, OPEN),
        Event(0.7, 1, DATA, CLIENT, b"INIT\r\n"),
        Event(9.0, 1, DATA, SERVER, b"STA {Time 40.10}\r\n"),
        Event(9.9, 1, DATA, CLIENT, b"DRIVE\r\n"),
        Event(10.0, 1, DATA, SERVER, b"STA {Time 40.30}\r\nSEN {Type INS}\r\n"),
        Event(10.5, 2, OPEN),
        Event(10.6, 1, END, CLIENT),
        Event(12.6, 2, DATA, CLIENT, b"GETPOS\r\n"),
    ]
    found = [(cue.elapsed, round(cue.pause, 3)) for cue in cues(events)]
    assert found[1] == (None, 0.7)
    assert found[3] == (0.0, 0.0)
    assert round(found[5][0] or 0.0, 3) == 0.2
    assert found[7] == (found[5][0], 2.0)


def test_times_may_be_cut_anywhere() -> None:
    """A time in two pieces is told when its end is there; who has left tells none."""
    clock = SessionClock()
    assert not clock.hear(1, b"STA {Type X} {Tim")
    assert clock.hear(1, b"e 7.00}\r\n")
    assert clock.elapsed == 0.0
    clock.hear(1, b"STA {Time 8.00}")
    clock.end(1)
    assert not clock.telling
    clock.hear(2, b"STA {Time 20.00}")
    clock.hear(2, b"STA {Time 20.50}")
    assert clock.elapsed == 1.5
