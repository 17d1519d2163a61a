"""Physics-as-Inverse-Graphics in TensorFlow 2, short: a reference for the port. Images are [.., H, W, C]."""
import os

# TensorFlow otherwise greets on every start.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
