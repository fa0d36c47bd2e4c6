"""Instruments that look inside a process: what a step, a ray, a frame or a thread costs."""
