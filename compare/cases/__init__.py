"""One folder for each submodule: what is computed, in words (README.md), what is drawn (case.py), the port's side (mod.rs)."""
