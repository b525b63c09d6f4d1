"""Samples, records and batches; photos and their masks.

From a sample to a batch: `schema` defines samples, `codec` encodes them as records, `dataset` reads
records, `batches` resizes them (`resample`) and draws points, `augment` augments them (`framing`,
`effects`), and `loader` makes batches in threads or processes. `photo` and `framing` prepare a
photo for a network. `shards` writes data sets for `conversion` and `data_gen`.
"""
