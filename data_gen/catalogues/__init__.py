"""Catalogues of models, a module for each, with a common interface (`entry.Catalogue`)."""
