"""Compares this reference with a folder of golden files: python -m torch_reference.check_goldens goldens"""
from shared.checks import check_folder

from .evaluate import evaluate

if __name__ == "__main__":
    check_folder(evaluate, __doc__)
