"""Propagation models, one file each; every module here is loaded when a model is asked for."""
