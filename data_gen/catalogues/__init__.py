"""Catalogues of models, one per file, with a common interface (`entry.Catalogue`)."""
