"""Training data: what a sample is, where it comes from and how it becomes a batch."""
