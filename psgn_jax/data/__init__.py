"""Samples, records and batches; photos and their masks.

The way of a sample into a row of a batch: `schema` defines it, `codec` makes a record of it,
`dataset` reads the record, `batches` resizes it (`resize`) and draws its points, `augment` changes
it (`framing`, `resample`, `photo_effects`), and `loader` makes batches in threads or processes. The
way of a photo into a network: `photo` reads it, `masks` finds the object, `framing` places it.
`shards` writes data sets of many files or models, which may take days; `conversion` uses it for
published data sets, and `data_gen` for renderings.
"""
