"""USD stages through Pixar's library (`pxr`, the package usd-core), which is optional.

Everything in here imports it; `usd.py` beside this folder does so only when a stage is read.
"""
