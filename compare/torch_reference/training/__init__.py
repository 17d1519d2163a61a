"""The fast recipe in PyTorch, short: it trains the reference network, with any of the known defects switched on.

Written after src/recipe and src/physics_models/refinement.rs; its numbers come from configs/fast.toml.
"""
