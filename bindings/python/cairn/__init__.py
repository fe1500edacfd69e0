"""Cairn from Python. `cairn.build` makes world bundles."""
