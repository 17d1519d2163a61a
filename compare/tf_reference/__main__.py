"""Computes a folder of drawn inputs in double precision: python -m <reference> GIVEN OUT"""
from shared.evaluate_folder import main

from .evaluate import evaluate

main(evaluate)
