"""The rules: one function each, entered with `@check`."""
