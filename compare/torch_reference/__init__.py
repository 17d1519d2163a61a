"""Physics-as-Inverse-Graphics in PyTorch, short: a reference for the port. Images are [.., C, H, W] inside."""
