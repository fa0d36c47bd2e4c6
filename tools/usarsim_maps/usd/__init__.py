"""Stages of USD."""
