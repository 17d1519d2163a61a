"""One folder for each submodule: what is drawn (case.py), what is computed (README.md), the tolerances."""
