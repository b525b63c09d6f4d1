"""Training data: samples, data sets, readers of published data, augmentation and batches."""
