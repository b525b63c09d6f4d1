"""Samples, records and batches; photos and their masks.

A sample becomes a row of a batch: `schema` defines it, `codec` makes a record of it, `dataset`
reads the record, `batches` resizes it (`resize`) and draws its points, `augment` changes it
(`framing`, `resample`, `effects`), and `loader` makes batches in threads or processes.
`photo` and `framing` prepare a photo for a network. `shards` writes data sets of many files or
models, for `conversion` and `data_gen`.
"""
