"""The fast recipe in PyTorch, short: it trains the reference network, with any of the known defects switched on.

Written after the port's src/training and refinement, as they stood on 2026-11-21; its numbers come from recipe.toml.
"""
