"""A second, independent implementation of what a world bundle computes.

It follows the specification of the format (`docs/bundle.md`) and the published description of the model, in plain numpy and float64.
It shares no code with the library or the bundle builder and keeps no cache; it need not be fast.
"""
