"""A second, independent account of what a world bundle computes.

Everything here is written from the format's norm (`docs/bundle.md`) and the published description of the model, in
plain numpy and in float64. It shares no code with the library or with the bundle builder, keeps no cache, and is slow
on purpose.
"""
